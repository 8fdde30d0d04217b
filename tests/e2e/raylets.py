"""A real Ray cluster for tests: its nodes are processes of this machine."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import psutil

PATIENCE_S = 300.0
"""Time within which a node starts and a build ends [s]."""


@dataclass
class Raylets:
    """A cluster; its nodes are processes of this test, and go with it."""

    home: Path
    address: str = ""
    started: dict[str, subprocess.Popen[bytes]] = field(default_factory=dict)

    def start(self, name: str, *words: str) -> None:
        """Start a node, the first as the head."""
        store = {"DXB_NODE_STORE": str(self.home / f"store_{name}")}
        common = [
            "--num-cpus=2",
            "--object-store-memory=80000000",
            "--disable-usage-stats",
            f"--temp-dir={self.home}/r",
        ]
        said = self.home / f"{name}.log"
        with open(said, "wb") as log:
            self.started[name] = subprocess.Popen(
                [sys.executable, "-m", "ray.scripts.scripts", "start", "--block", *common, *words],
                env={**os.environ, **store, "RAY_USAGE_STATS_ENABLED": "0"},
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
        end = time.monotonic() + PATIENCE_S
        while "Ray runtime started" not in said.read_text():
            assert self.started[name].poll() is None, said.read_text()
            assert time.monotonic() < end, said.read_text()
            time.sleep(0.1)

    def end(self, name: str) -> None:
        """Kill a node and all that runs on it, at once."""
        root = self.started.pop(name)
        family = [psutil.Process(root.pid), *psutil.Process(root.pid).children(recursive=True)]
        for process in family:
            with suppress(psutil.NoSuchProcess):
                process.kill()
        root.wait(30)
        psutil.wait_procs(family[1:], timeout=30)

    def workers(self) -> list[psutil.Process]:
        """Processes that Ray runs calls in, and what these started."""
        rays = [child for root in self.started.values() for child in _children(root.pid) if _is_at_work(child)]
        return [*rays, *(child for ray in rays for child in _children(ray.pid))]


def _children(pid: int) -> list[psutil.Process]:
    """Descendants of a process; none if it has ended."""
    with suppress(psutil.NoSuchProcess):
        return psutil.Process(pid).children(recursive=True)
    return []


def _is_at_work(process: psutil.Process) -> bool:
    """Whether Ray runs a call or keeps a model in a process, by the name that Ray gives it then."""
    with suppress(psutil.Error):
        return " ".join(process.cmdline()).startswith(("ray::carry_out", "ray::Holder"))
    return False


@contextmanager
def raylets() -> Iterator[Raylets]:
    """A cluster of two nodes, `site:a` and `site:b`, that ends with the block."""
    # The path of a socket may be 107 bytes long, so the folder has a short one.
    with tempfile.TemporaryDirectory(prefix="dxb-ray-", ignore_cleanup_errors=True) as folder, socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
        free.close()
        cluster = Raylets(Path(folder), f"127.0.0.1:{port}")
        try:
            site = '{"site:a": 1}'
            cluster.start(
                "a",
                "--head",
                "--node-ip-address=127.0.0.1",
                f"--port={port}",
                "--include-dashboard=false",
                f"--resources={site}",
            )
            cluster.start(
                "b",
                f"--address={cluster.address}",
                "--node-ip-address=127.0.0.1",
                "--num-gpus=1",  # none is needed: the test's model does without
                '--resources={"site:b": 1}',
            )
            yield cluster
        finally:
            for name in list(cluster.started):
                cluster.end(name)

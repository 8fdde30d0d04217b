"""BuildGrid (PyPI `buildgrid`): its server with what a cache needs, its command line, and its generated messages."""

from __future__ import annotations

import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.store.remotes.servers import MOTO, free_port

BGD = MOTO.with_name("bgd")
CONFIG = """
description: a cache without workers
server:
  - !channel
    address: "127.0.0.1:{port}"
    insecure-mode: {insecure}
{credentials}
authorization: {authorization}
storages:
  - !disk-storage &storage
    path: {root}/blobs
caches:
  - !lru-action-cache &actions
    storage: *storage
    max-cached-refs: 256
    allow-updates: {updates}
    cache-failed-actions: true
instances:
  - name: ""
    services: &services
      - !action-cache
        cache: *actions
      - !cas
        storage: *storage
      - !bytestream
        storage: *storage
  - name: team/main
    services: *services
thread-pool-size: 20
"""


def program() -> str:
    """The command `bgd`; the test is skipped where it is not installed."""
    if not BGD.exists():
        pytest.skip("BuildGrid is not installed; `make servers` does it")
    return str(BGD)


def python() -> str:
    """The interpreter that has BuildGrid's generated messages."""
    return str(Path(program()).with_name("python"))


def bgd(port: int, *words: str) -> str:
    """What one of BuildGrid's clients prints; it must succeed."""
    group, *rest = words
    done = subprocess.run(
        [program(), group, "--remote", f"http://127.0.0.1:{port}", *rest], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@contextmanager
def running(
    root: Path, *, updates: bool = True, secret: str = "", credentials: str = ""
) -> Iterator[tuple[int, subprocess.Popen[bytes]]]:
    """A server of its own: (port, process); it listens when the block begins."""
    port = free_port()
    authorization = f"{{method: jwt, algorithm: hs256, secret: {secret}}}" if secret else "{method: none}"
    root.mkdir(parents=True, exist_ok=True)
    text = CONFIG.format(
        port=port,
        root=root,
        updates=str(updates).lower(),
        authorization=authorization,
        credentials=credentials,
        insecure=str(not credentials).lower(),
    )
    (root / "config.yml").write_text(text)
    with (root / "log").open("wb") as log:
        server = subprocess.Popen([program(), "server", "start", str(root / "config.yml")], stdout=log, stderr=log)
    try:
        _wait(port, server, root / "log")
        yield port, server
    finally:
        server.kill()
        server.wait()


def _wait(port: int, server: subprocess.Popen[bytes], log: Path) -> None:
    for _ in range(1800):  # a loaded machine imports it for half a minute
        assert server.poll() is None, log.read_text()
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.1)
    raise AssertionError(log.read_text())

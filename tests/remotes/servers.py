"""Real servers in temporary folders: our own, nginx with WebDAV, and an S3 server."""

from __future__ import annotations

import os
import random
import shutil
import socket
import subprocess
import threading
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from dextera_build.remotes.server import CacheServer
from dextera_build.store.store import Store

REPO = Path(__file__).parents[2]
MOTO = Path(os.environ.get("DXB_SERVERS", REPO / ".venv" / "servers")) / "bin" / "moto_server"
"""Servers have their own environment, which `make servers` installs."""


def free_port() -> int:
    """A port for a server that starts later, outside the range that the system assigns."""
    first = int(Path("/proc/sys/net/ipv4/ip_local_port_range").read_text().split()[0])
    while True:
        with socket.socket() as probe, suppress(OSError):
            probe.bind(("127.0.0.1", random.SystemRandom().randrange(10_000, first)))
            return int(probe.getsockname()[1])


@contextmanager
def deaf_port() -> Iterator[int]:
    """A port that is in use and refuses every connection."""
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))
        yield int(held.getsockname()[1])


@contextmanager
def own(folder: Path, **flags: object) -> Iterator[str]:
    """`dxb cache serve` in a thread."""
    with CacheServer(Store(folder), ("127.0.0.1", 0), **flags) as server:  # type: ignore[arg-type]
        threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
        yield server.url
        server.shutdown()


@contextmanager
def nginx(folder: Path, more: str = "") -> Iterator[str]:
    """Nginx with `cache/nginx.conf`; `more` is added to its location."""
    program = shutil.which("nginx") or shutil.which("nginx", path="/usr/sbin")
    if program is None:
        pytest.skip("nginx is not installed")
    port = free_port()
    text = (REPO / "cache" / "nginx.conf").read_text().replace("127.0.0.1:8098", f"127.0.0.1:{port}")
    text = text.replace("dav_methods PUT;", f"dav_methods PUT; {more}")
    (folder / "data" / ".tmp" / "put").mkdir(parents=True)
    config = folder / "nginx.conf"
    # Under root, nginx workers run as the user in the file, who has no access to a test's folder.
    config.write_text(text.replace("user www-data;", "user root;") if os.geteuid() == 0 else text)
    words = [program, "-p", str(folder), "-c", str(config), "-e", str(folder / "error.log"), "-g", "daemon off;"]
    with _running(words, f"http://127.0.0.1:{port}", folder):
        yield f"http://127.0.0.1:{port}"


@contextmanager
def s3(folder: Path) -> Iterator[str]:
    """Moto's S3 server with a bucket `twins`; yields its endpoint."""
    if not MOTO.exists():
        pytest.skip("no S3 server; `make servers` installs one")
    port = free_port()
    url = f"http://127.0.0.1:{port}"
    with _running([str(MOTO), "-H", "127.0.0.1", "-p", str(port)], url, folder):
        urllib.request.urlopen(urllib.request.Request(f"{url}/twins", method="PUT"), timeout=10).close()
        yield url


@contextmanager
def _running(words: list[str], url: str, folder: Path) -> Iterator[None]:
    with (folder / "server.log").open("w") as log:
        server = subprocess.Popen(words, stdout=log, stderr=subprocess.STDOUT)
    try:
        port = int(url.rpartition(":")[2])
        for _ in range(300):
            if server.poll() is not None:
                raise AssertionError((folder / "server.log").read_text())
            try:
                socket.create_connection(("127.0.0.1", port), timeout=1).close()
                break
            except OSError:
                time.sleep(0.1)
        yield
    finally:
        server.terminate()
        server.wait(20)

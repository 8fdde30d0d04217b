"""Servers that answer with anything: a build slows down, runs what it does not get, and ends right."""

from __future__ import annotations

import gzip
import re
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

from dextera_build.engine.run import RunResult
from dextera_build.remotes import http
from dextera_build.remotes.breaker import Guarded
from dextera_build.remotes.exchange import Exchange
from dextera_build.remotes.folder import Directory
from dextera_build.remotes.transfer import Transfer
from dextera_build.store import disk_full
from dextera_build.store import entry as entries
from dextera_build.store.blobs import Blobs
from dextera_build.store.store import Store
from tests.engine.tiny import Record, run, scene
from tests.store.stores import forged

HEX = "ab" * 32


@dataclass
class Answer:
    """What a server says to one request."""

    status: int
    headers: dict[str, str]
    pieces: Iterator[bytes]


Says = Callable[[str, bytes | None], Answer]
"""(path, what an honest server has there) -> what this one says."""


def whole(data: bytes, status: int = 200) -> Answer:
    return Answer(status, {"Content-Length": str(len(data))}, iter([data]))


def endless(piece: bytes, pause_s: float = 0.0) -> Answer:
    def pieces() -> Iterator[bytes]:
        while True:
            yield piece
            time.sleep(pause_s)

    return Answer(200, {}, pieces())


@contextmanager
def serving(folder: Path, says: Says) -> Iterator[str]:
    """A Bazel HTTP cache over a folder, which says what it likes."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            kind, _, name = self.path.strip("/").partition("/")
            file = folder / kind / name[:2] / name[2:]
            answer = says(self.path, file.read_bytes() if file.is_file() else None)
            self.send_response(answer.status)
            for header, value in answer.headers.items():
                self.send_header(header, value)
            self.end_headers()
            try:
                for piece in answer.pieces:
                    self.wfile.write(piece)
            except OSError:
                self.close_connection = True

        def log_message(self, *words: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}"
    finally:
        server.shutdown()
        server.server_close()


def ruin(data: bytes) -> bytes:
    return bytes([data[0] ^ 1, *data[1:]])


def entry_of(change: Callable[[list[Any]], list[Any]]) -> Says:
    """A server whose entries are changed, and whose blobs are right."""

    def says(path: str, data: bytes | None) -> Answer:
        if data is None:
            return whole(b"", 404)
        return whole(forged(data, files=change) if path.startswith("/ac/") else data)

    return says


def packed(data: bytes) -> Answer:
    """Compressed on the way, though nobody asked for that."""
    small = gzip.compress(data, 1)
    return Answer(200, {"Content-Encoding": "gzip", "Content-Length": str(len(small))}, iter([small]))


def blobs_are(make: Callable[[bytes], Answer]) -> Says:
    """A server whose entries are right, and whose blobs are not."""

    def says(path: str, data: bytes | None) -> Answer:
        if data is None:
            return whole(b"", 404)
        return whole(data) if path.startswith("/ac/") else make(data)

    return says


SERVERS: dict[str, Says] = {
    "other bytes": blobs_are(lambda data: whole(ruin(data))),
    "fewer bytes": blobs_are(lambda data: whole(data[:-1])),
    "more bytes": blobs_are(lambda data: whole(data + b"x")),
    "blobs without end": blobs_are(lambda data: endless(bytes(1 << 16))),
    "a length that is none": blobs_are(lambda data: Answer(200, {"Content-Length": "-1"}, iter([data]))),
    "an empty answer": blobs_are(lambda data: whole(b"")),
    "a page": blobs_are(lambda data: whole(b"<html>sign in</html>")),
    "entries without end": lambda path, data: endless(b"\x12\x00" * 4096),
    "entries of noise": lambda path, data: whole(b"\xff" * 1000),
    "round in circles": lambda path, data: Answer(302, {"Location": path, "Content-Length": "0"}, iter([])),
    "to a file": lambda path, data: Answer(302, {"Location": "file:/etc/passwd"}, iter([])),
    "a status that is none": lambda path, data: whole(b"", 999),
    "bombs": blobs_are(lambda data: packed(bytes(16 << 20))),
    "packed entries": lambda path, data: packed(bytes(8 << 20)),
    "errors": lambda path, data: whole(b"no", 500),
    "a way out": entry_of(lambda files: [*files, ["../../evil", HEX, 1]]),
    "a way out of the closure": entry_of(lambda files: [*files, ["closure", f"../{HEX}", 1]]),
    "no output": entry_of(lambda files: [file for file in files if file[0] != "output"]),
    "no result": lambda path, data: whole(b"", 404) if data is None else whole(data.partition(b"\n")[0]),
    "100,000 outputs": entry_of(lambda files: [*files, *(["closure", f"{n:064x}", 1] for n in range(100_000))]),
    "more than the disk holds": entry_of(lambda files: [*files, ["closure", HEX, (1 << 48) - 1]]),
}


def build(store: Store, url: str, timeout_s: float = 1.0) -> tuple[RunResult, Record]:
    remote = Guarded("lab", url, lambda: http.HttpCache(url, timeout_s=timeout_s), mode="r", timeout_s=timeout_s)
    return run(scene(), store, exchange=Exchange(store, [remote]))


@pytest.fixture
def share(tmp_path: Path) -> Path:
    """The store of an honest colleague."""
    run(scene(), Store(tmp_path / "share"))
    return tmp_path / "share"


@pytest.mark.parametrize("name", SERVERS)
def test_a_build_is_right_whatever_a_server_says(tmp_path, share, monkeypatch, name):
    monkeypatch.setattr("dextera_build.remotes.remote.MOST_ENTRY", 1 << 20)
    before = {path for path in tmp_path.rglob("*") if not path.is_relative_to(tmp_path / "mine")}
    mine = Store(tmp_path / "mine")
    with serving(share, SERVERS[name]) as url:
        result, record = build(mine, url)
    assert result.ok
    assert len(record.with_status("ran")) + len(record.with_status("fetched")) + len(record.with_status("cached")) == 6
    expected, _ = run(scene(), Store(share))
    assert {name: node.output for name, node in result.nodes.items()} == {
        name: node.output for name, node in expected.nodes.items()
    }
    assert all(mine.blobs.verify(digest) for digest, _ in mine.blobs.all())
    assert list(mine.root.rglob(".tmp-*")) == []
    assert {path for path in tmp_path.rglob("*") if not path.is_relative_to(mine.root)} == before


def test_an_honest_server_is_believed(tmp_path, share):
    """The same server, so that what the others are refused for is what they changed."""
    with serving(share, blobs_are(whole)) as url:
        _, record = build(Store(tmp_path / "mine"), url, timeout_s=20.0)
    assert len(record.with_status("fetched")) == 6


@pytest.mark.medium
@pytest.mark.parametrize("drips", ["entries", "blobs"])
def test_a_server_that_drips_is_left_alone(tmp_path, share, monkeypatch, drips):
    """A byte now and then keeps every wait short; what is promised must not make it long: the entry says terabytes."""
    monkeypatch.setattr(disk_full, "free_bytes", lambda path: 1 << 60)

    def says(path: str, data: bytes | None) -> Answer:
        if data is None:
            return whole(b"", 404)
        if drips == "entries" or not path.startswith("/ac/"):
            return endless(b"x", 0.05)
        return whole(forged(data, files=lambda files: [*files, ["closure", HEX, 1 << 42]]))

    began = time.monotonic()
    with serving(share, says) as url:
        result, record = build(Store(tmp_path / "mine"), url, timeout_s=0.3)
    assert result.ok
    assert len(record.with_status("ran")) == 6
    assert time.monotonic() - began < 60


def test_what_cannot_fit_is_not_begun(tmp_path, share, monkeypatch):
    mine = Store(tmp_path / "mine")
    key = next(iter(Store(share).actions.keys()))
    monkeypatch.setattr(disk_full, "free_bytes", lambda path: 0)
    monkeypatch.setattr(Blobs, "receive", lambda *words: pytest.fail("bytes were asked for"))
    assert Transfer(mine).fetch(Directory(share), key) is None


@pytest.mark.parametrize("number", ["1e400", "-1e400", "9" * 400, "NaN"])
def test_a_number_beyond_all_floats_is_refused(share, number):
    store = Store(share)
    key = next(iter(store.actions.keys()))
    whole_entry = store.actions.entry(key)
    assert whole_entry is not None
    for good in (b'"seconds":', b'"metrics":{"size":['):
        pattern, other = re.escape(good) + rb"[^,\]}]+", good + number.encode()
        changed = forged(whole_entry.spell(), result=lambda made: re.sub(pattern, other, made))  # noqa: B023
        assert changed != forged(whole_entry.spell())
        with pytest.raises(ValueError, match="not a finite number"):
            entries.read(changed)

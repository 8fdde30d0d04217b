"""A store that is full, or that may only be read."""

from __future__ import annotations

import errno
import os
import resource
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from dextera_build.engine.run import build
from dextera_build.errors import StoreError
from dextera_build.runs.events import Event
from dextera_build.runs.log import EventLog
from dextera_build.store.store import Store
from tests.engine.tiny import Record, call, graph, inline, leaf, out


def as_nobody(work: Callable[[], int]) -> int:
    """Run `work` in a child that has no right to write, and return its exit code."""
    pid = os.fork()
    if pid == 0:
        try:
            if os.geteuid() == 0:
                os.setresgid(65534, 65534, 65534)
                os.setresuid(65534, 65534, 65534)
            os._exit(work())
        except BaseException as error:
            print(repr(error), file=sys.stderr)
            os._exit(99)
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])


@pytest.fixture
def sealed(tmp_path: Path) -> Iterator[Path]:
    """A store with one result that nobody may write to."""
    root = tmp_path / "store"
    (tmp_path / "photo").write_text("pixels")
    run(root, tmp_path)
    for path in (tmp_path, *tmp_path.parents):
        if path.owner() == Path(tmp_path).owner() and path != Path("/"):
            path.chmod(path.stat().st_mode | 0o055)
    folders = [root, *(path for path in root.rglob("*") if path.is_dir())]
    for path in folders:
        path.chmod(0o555)
    yield root
    for path in folders:
        path.chmod(0o755)


def run(root: Path, tmp_path: Path, value: int = 0) -> tuple[bool, Record, list[StoreError]]:
    record = Record()
    plan = graph(call("a", "blob", photo=leaf(tmp_path / "photo")), call("b", value=value, a=out("a")))
    result = build(plan, [("b",)], store=Store(root), executor=inline(), listen=record)
    return result.ok, record, [node.error for node in result.nodes.values() if isinstance(node.error, StoreError)]


def test_a_store_that_can_only_be_read_still_serves(sealed: Path, tmp_path: Path) -> None:
    def work() -> int:
        ok, record, _ = run(sealed, tmp_path)
        return 0 if ok and record.with_status("cached") == ["a", "b"] else 1

    assert as_nobody(work) == 0


def test_a_new_result_for_it_is_one_clear_error(sealed: Path, tmp_path: Path) -> None:
    def work() -> int:
        ok, _, errors = run(sealed, tmp_path, value=1)
        (error,) = errors
        assert (error.message, error.code) == ("the store cannot be written", "DXB-S102")
        assert error.hint == "set `DXB_CACHE` to a folder that you may write to"
        assert error.facts["system says"] == "Permission denied"
        return 0 if not ok else 1

    assert as_nobody(work) == 0


def test_its_event_log_is_left_out(sealed: Path) -> None:
    def work() -> int:
        with EventLog(Store(sealed)) as log:
            log(Event(0.0))
            return 0 if log.run == "" else 1

    assert as_nobody(work) == 0


def test_a_folder_that_cannot_be_made_is_said(sealed: Path) -> None:
    def work() -> int:
        with pytest.raises(StoreError, match="the store cannot be written"):
            Store(sealed / "inner" / "store")
        return 0

    assert as_nobody(work) == 0


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT])
def test_a_full_disk_is_one_clear_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int) -> None:
    store = Store(tmp_path / "store")
    store.blobs.put(b"first")

    def full(descriptor: int, data: bytes) -> int:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, "write", full)
    with pytest.raises(StoreError, match="the store is full") as caught:
        store.blobs.put(b"second")
    monkeypatch.undo()
    assert caught.value.code == "DXB-S101"
    assert caught.value.facts["free"].endswith("MiB")
    assert caught.value.hint is not None
    assert [path.name for path in (tmp_path / "store" / "cas" / ".tmp").iterdir()] == []


def test_a_disk_that_fills_up_in_a_build_leaves_the_store_whole(tmp_path: Path) -> None:
    root = tmp_path / "store"
    (tmp_path / "photo").write_bytes(os.urandom(200_000))

    def work() -> int:
        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
        try:
            run(root, tmp_path)
        except StoreError as error:
            return 0 if error.code == "DXB-S101" else 1
        return 2

    pid = os.fork()
    if pid == 0:
        os._exit(work())
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0
    ok, _, _ = run(root, tmp_path)
    assert ok

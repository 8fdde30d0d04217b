"""A file system without locks, as some network file systems are: everything works, and a collection is more careful."""

from __future__ import annotations

import ctypes
import errno
import fcntl
import os
import platform
import struct
import time
from pathlib import Path

import pytest

from dextera_build.gc.choose import Limits
from dextera_build.gc.collect import collect
from dextera_build.store.locks import Locks
from dextera_build.store.store import Store
from tests.chaos.children import dxb
from tests.chaos.scenarios import BUILD, project
from tests.engine.tiny import call, graph, out, run
from tests.store.stores import age_all, key_of, publish

DAY = 86400.0
LOCK_CALLS = {"x86_64": (72, 73), "aarch64": (25, 32)}.get(platform.machine(), (0, 0))
"""Numbers of the system calls `fcntl` and `flock`."""


@pytest.fixture(params=[errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS])
def lockless(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*arguments: object) -> None:
        raise OSError(request.param, os.strerror(request.param))

    monkeypatch.setattr(fcntl, "lockf", refuse)


@pytest.mark.usefixtures("lockless")
def test_every_lock_is_given_and_said_to_be_worth_nothing(tmp_path: Path) -> None:
    locks = Locks(tmp_path / "locks")
    assert locks.take(key_of("a"))
    locks.release(key_of("a"))
    assert not locks.reliable()
    assert not locks.is_held_elsewhere(key_of("a"))


@pytest.mark.usefixtures("lockless")
def test_builds_go_on(tmp_path: Path) -> None:
    store = Store(tmp_path / "store")
    result, _ = run(graph(call("a"), call("b", a=out("a"))), store)
    assert result.ok
    assert list((store.local / "running").iterdir()) == []


@pytest.mark.usefixtures("lockless")
def test_a_collection_spares_the_last_day(tmp_path: Path) -> None:
    store = Store(tmp_path / "store")
    publish(store, "a")
    age_all(store, time.time() - 0.9 * DAY)
    collect(store, dict, Limits(size=0), dry=False)
    assert len(list(store.actions.keys())) == 1
    age_all(store, time.time() - 1.1 * DAY)
    collect(store, dict, Limits(size=0), dry=False)
    assert list(store.actions.keys()) == []


@pytest.mark.usefixtures("lockless")
def test_an_announcement_counts_for_a_week_though_nobody_can_tell_who_lives(tmp_path: Path) -> None:
    store = Store(tmp_path / "store")
    publish(store, "a")
    age_all(store, time.time() - 2 * DAY)
    announcement = store.local / "running" / "other-1-1"
    announcement.parent.mkdir(parents=True)
    announcement.write_text("{}")
    for days, left in ((3, 1), (8, 0)):
        then = time.time() - days * DAY
        os.utime(announcement, (then, then))
        collect(store, dict, Limits(size=0), dry=False)
        assert len(list(store.actions.keys())) == left


@pytest.mark.skipif(not any(LOCK_CALLS), reason="the numbers of system calls are known for two kinds of machines")
@pytest.mark.parametrize("number", [errno.ENOLCK, errno.ENOSYS])
def test_the_local_state_is_kept_and_the_file_system_is_named_once(tmp_path: Path, number: int) -> None:
    """Here the system itself refuses, also SQLite, which takes ENOLCK for a lock of somebody else."""
    space = project(tmp_path)
    first = dxb(space.root, *BUILD, begin=lambda: _refuse_locks(number))
    assert first.code == 0, first.text
    assert first.text.count("has no locks") == 1
    assert str(space.root / "cache") in first.text
    assert Store(space.root / "cache").state.kinds()
    again = dxb(space.root, *BUILD, begin=lambda: _refuse_locks(number))
    assert "up to date" in again.text


def _refuse_locks(number: int) -> None:
    """From now on, the system answers requests for file locks of this process with an error."""
    load, equal, above, beyond, give = 0x20, 0x15, 0x35, 0x25, 0x06  # instructions of BPF
    rows = [
        (load, 0, 0, 0),  # the number of the call
        (equal, 4, 0, LOCK_CALLS[1]),  # flock
        (equal, 0, 4, LOCK_CALLS[0]),  # fcntl
        (load, 0, 0, 24),  # its command
        (above, 0, 2, fcntl.F_GETLK),  # F_GETLK, F_SETLK and F_SETLKW
        (beyond, 1, 0, fcntl.F_SETLKW),
        (give, 0, 0, 0x50000 | number),
        (give, 0, 0, 0x7FFF0000),
    ]
    code = ctypes.create_string_buffer(b"".join(struct.pack("HBBI", *row) for row in rows))

    class Program(ctypes.Structure):
        _fields_ = (("length", ctypes.c_ushort), ("code", ctypes.c_void_p))

    library, program = ctypes.CDLL(None), Program(len(rows), ctypes.addressof(code))
    assert library.prctl(38, 1, 0, 0, 0) == 0  # PR_SET_NO_NEW_PRIVS
    assert library.prctl(22, 2, ctypes.byref(program), 0, 0) == 0  # PR_SET_SECCOMP, a filter

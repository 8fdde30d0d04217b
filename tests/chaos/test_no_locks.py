"""A file system without locks, as some network file systems are: everything works, and a collection is more careful."""

from __future__ import annotations

import errno
import fcntl
import os
import time
from pathlib import Path

import pytest

from dextera_build.gc.choose import Limits
from dextera_build.gc.collect import collect
from dextera_build.store.locks import Locks
from dextera_build.store.store import Store
from tests.engine.tiny import call, graph, out, run
from tests.store.stores import age_all, key_of, publish

DAY = 86400.0


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

"""A store that a group shares: whatever their umask, its users build on one another's results and may collect them."""

from __future__ import annotations

import os
import sqlite3  # noqa: F401 - what another user may not read is loaded before one is he
import stat
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from dextera_build.engine.run import build
from dextera_build.gc.choose import Limits
from dextera_build.gc.collect import collect
from dextera_build.gc.verify import verify
from dextera_build.runs.events import Event
from dextera_build.runs.log import EventLog
from dextera_build.store.store import Store
from tests.engine.tiny import Record, call, graph, inline, out
from tests.store.stores import age_all

GROUP, ANN, BOB = 20_000, 20_001, 20_002

pytestmark = pytest.mark.skipif(os.geteuid() != 0, reason="only root can be two users")


def as_user(user: int, work: Callable[[], object]) -> None:
    """Carry `work` out as a user of the group who hides files from others by habit."""
    pid = os.fork()
    if pid == 0:
        try:
            os.setgroups([GROUP])
            os.setresgid(user, user, user)
            os.setresuid(user, user, user)
            os.umask(0o077)
            work()
            os._exit(0)
        except BaseException as error:
            print(f"{type(error).__name__}: {error}", file=sys.stderr)
            os._exit(1)
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0


@pytest.fixture
def root(tmp_path: Path) -> Path:
    for path in (tmp_path, *tmp_path.parents):
        if path != Path("/"):
            path.chmod(path.stat().st_mode | 0o011)
    made = tmp_path / "store"
    made.mkdir()
    os.chown(made, 0, GROUP)
    made.chmod(0o2770)
    return made


def run(root: Path, value: int) -> Record:
    record = Record()
    plan = graph(call("a", "blob"), call("b", "blob", value, a=out("a")))
    store = Store(root)
    with EventLog(store) as log:
        log(Event(time.time()))
    result = build(plan, [("b",)], store=store, executor=inline(), listen=record)
    assert result.ok
    assert log.run
    return record


def test_two_users_build_on_one_another(root: Path) -> None:
    as_user(ANN, lambda: run(root, 0))

    def second() -> None:
        assert run(root, 0).with_status("cached") == ["a", "b"]
        assert run(root, 1).with_status("ran") == ["b"]

    as_user(BOB, second)


def test_all_that_is_made_belongs_to_the_group(root: Path) -> None:
    as_user(ANN, lambda: run(root, 0))
    for path in root.rglob("*"):
        state = path.stat()
        assert state.st_gid == GROUP, path
        wanted = 0o2070 if path.is_dir() else 0o040
        assert state.st_mode & wanted == wanted, (path, stat.filemode(state.st_mode))
        assert not state.st_mode & 0o007, path
        if path.is_relative_to(root / "cas") and path.is_file():
            assert stat.S_IMODE(state.st_mode) == 0o440


def test_a_use_of_another_users_result_counts(root: Path) -> None:
    as_user(ANN, lambda: run(root, 0))
    age_all(Store(root), time.time() - 9 * 86400)

    def use_and_collect() -> None:
        assert run(root, 0).with_status("cached") == ["a", "b"]
        said = collect(Store(root), dict, Limits(since=time.time() - 86400), dry=False)
        assert [row.kind for row in said.gone] == []
        assert run(root, 0).with_status("cached") == ["a", "b"]

    as_user(BOB, use_and_collect)


def test_one_may_collect_and_repair_what_another_made(root: Path) -> None:
    as_user(ANN, lambda: run(root, 0))

    def collect_all() -> None:
        collect(Store(root), dict, Limits(size=0), dry=False)
        assert list(Store(root).actions.keys()) == []
        assert verify(Store(root), repair=True).is_whole

    as_user(BOB, collect_all)
    as_user(ANN, lambda: run(root, 1))


def test_a_store_of_ones_own_is_left_to_the_umask(tmp_path: Path) -> None:
    old = os.umask(0o077)
    try:
        Store(tmp_path / "own").blobs.put(b"private")
    finally:
        os.umask(old)
    assert {stat.S_IMODE(path.stat().st_mode) & 0o077 for path in (tmp_path / "own").rglob("*")} == {0}

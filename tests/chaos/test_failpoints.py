"""Builds, collections, uploads and imports that are stopped at any failpoint: the next build is as a clean one."""

from __future__ import annotations

import re
import signal
from bisect import bisect_left
from pathlib import Path

import pytest

from dextera_build.store import failpoints
from dextera_build.store.failpoints import POINTS
from tests.chaos.children import Said, dxb
from tests.chaos.scenarios import SCENARIOS, Clean, age, assert_as_clean, project, unfinished
from tests.e2e.space import Space

WHERE = {
    "folder.made": "first",
    "folder.aside": "shared",
    "file.made": "first",
    "file.written": "first",
    "file.moved": "first",
    "blob.aside": "damaged blobs",
    "result.blobs": "first",
    "result.published": "first",
    "result.damaged": "damaged entries",
    "result.diverged": "shaken",
    "use.noted": "aged",
    "leaves.save": "first",
    "snapshot.saved": "unpinned",
    "history.saved": "went on",
    "keep.aside": "first",
    "log.made": "first",
    "log.event": "first",
    "lock.made": "first",
    "lock.taken": "first",
    "running.announced": "first",
    "running.ended": "first",
    "running.forgotten": "collection",
    "collect.file": "collection",
    "collect.results": "collection",
    "collect.blobs": "collection",
    "collect.log": "old logs",
    "repair.found": "repair",
    "export.cleared": "edited",
    "export.written": "first",
    "export.stamp": "first",
    "place.copied": "first",
    "pins.write": "first",
    "remote.blob": "push",
    "remote.entry": "push",
    "fetch.blobs": "fetch",
    "import.blobs": "import",
}
"""Failpoint -> a scenario in which it is reached."""
FRESH = ("first", "unpinned")
"""Scenarios of a project that was never built; a build with `--lock` saves no snapshot."""
QUICK = ("file.written", "result.blobs", "result.published", "export.stamp", "log.event")
"""Those that the fast tests stop at; all others take minutes."""
FAILING = [name for name, point in POINTS.items() if point.fails]


def stopped(folder: Path, scenario: str, failpoint: str) -> tuple[Space, Said]:
    """A project in which the command of a scenario came to a failpoint."""
    space = project(folder / "project")
    SCENARIOS[scenario].prepare(space)
    return space, dxb(space.root, *SCENARIOS[scenario].words, failpoint=failpoint)


def assert_recovers(space: Space, scenario: str, clean: Clean) -> None:
    """The next command goes through, and what is there then is what a clean build makes."""
    again = dxb(space.root, *(SCENARIOS[scenario].again or SCENARIOS[scenario].words))
    assert again.code == 0, again.text
    assert_as_clean(space, clean(space))
    if "damaged" in scenario:
        dxb(space.root, "cache", "verify", "--repair")
    whole = dxb(space.root, "cache", "verify")
    assert whole.code == 0, whole.text
    age(space.root, 90_000.0)
    if scenario == "push":
        assert dxb(space.root, *SCENARIOS[scenario].words).code == 0
    collected = dxb(space.root, "cache", "gc", "--yes")
    assert collected.code == 0, collected.text
    assert_as_clean(space, clean(space))
    assert unfinished(space) == []


def test_every_failpoint_is_declared_placed_and_tried() -> None:
    """Promise: no step that changes the disk is left out of the tests by a slip of the pen."""
    sources = Path(failpoints.__file__).parents[1].rglob("*.py")
    placed = [name for path in sources for name in re.findall(r'failpoints\.reach\("([^"]+)"\)', path.read_text())]
    assert set(placed) == set(POINTS)
    assert set(WHERE) == set(POINTS)


def kill_and_recover(folder: Path, name: str, clean: Clean, count: int = 1) -> None:
    space, said = stopped(folder, WHERE[name], f"{name}:kill:{count}")
    assert said.code == -signal.SIGKILL, f"`{name}` was not reached: {said.text}"
    assert_recovers(space, WHERE[name], clean)


@pytest.mark.medium
@pytest.mark.parametrize("name", QUICK)
def test_the_next_build_after_a_kill_is_as_a_clean_one(name: str, tmp_path: Path, clean: Clean) -> None:
    """Promise: kill -9 at the steps that publish a result costs no more than what was not published."""
    kill_and_recover(tmp_path, name, clean)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in POINTS if name not in QUICK])
def test_the_next_build_after_a_kill_anywhere_is_as_a_clean_one(name: str, tmp_path: Path, clean: Clean) -> None:
    """Promise: kill -9 at any step that changes the disk leaves nothing that the next build stumbles over."""
    kill_and_recover(tmp_path, name, clean)


@pytest.fixture(scope="module")
def files_of_a_build(tmp_path_factory: pytest.TempPathFactory) -> int:
    """How many files the build of scenario `first` writes."""

    def is_beyond(count: int) -> bool:
        return stopped(tmp_path_factory.mktemp("count"), "first", f"file.written:kill:{count}")[1].code == 0

    return bisect_left(range(1, 1000), True, key=is_beyond)


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("does", ["kill", "full"])
def test_the_next_build_after_a_stop_at_any_file_is_as_a_clean_one(
    does: str, tmp_path: Path, clean: Clean, files_of_a_build: int
) -> None:
    """Promise: a kill or a full disk before any file of a build takes its name costs only what was not finished."""
    assert files_of_a_build > 9 + 4 + 1  # entries, exports and the lock file, of what else there is
    for count in range(1, files_of_a_build + 1):
        space, said = stopped(tmp_path / str(count), "first", f"file.written:{does}:{count}")
        assert said.code in ((-signal.SIGKILL,) if does == "kill" else (0, 1)), said.text
        assert said.text.count("error[") == (said.code == 1), said.text
        assert_recovers(space, "first", clean)


@pytest.mark.slow
@pytest.mark.parametrize("does", ["error", "full"])
@pytest.mark.parametrize("name", FAILING)
def test_what_the_system_refuses_is_one_clear_error_or_does_not_matter(
    name: str, does: str, tmp_path: Path, clean: Clean
) -> None:
    """Promise: a failing or full disk at any step ends in one error with a code, never in a traceback."""
    space, said = stopped(tmp_path, WHERE[name], f"{name}:{does}")
    assert said.code in (0, 1), said.text
    # What an upload or a repair leaves over is listed, and is no error.
    assert said.text.count("error[") == (said.code and WHERE[name] not in ("push", "repair")), said.text
    assert "Traceback" not in said.text
    assert_recovers(space, WHERE[name], clean)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name, scenario in WHERE.items() if scenario in FRESH])
def test_ctrl_c_anywhere_leaves_a_store_to_go_on_from(name: str, tmp_path: Path, clean: Clean) -> None:
    """Promise: Ctrl-C at any step ends the build with code 130, and the next one goes on."""
    space, said = stopped(tmp_path, WHERE[name], f"{name}:interrupt")
    assert said.code == 130, said.text
    assert "Traceback" not in said.text
    assert_recovers(space, WHERE[name], clean)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name, scenario in WHERE.items() if scenario in FRESH])
def test_real_processes_recover_too(name: str, tmp_path: Path, clean: Clean) -> None:
    """Promise: so it is for `dxb` as people start it, with workers; a worker that dies fails its node alone."""
    space = project(tmp_path / "project")
    words = SCENARIOS[WHERE[name]].words
    answer = space.dxb(*words, env={failpoints.VARIABLE: f"{name}:kill"})
    assert answer.code in (-signal.SIGKILL, 1), answer.err
    assert answer.code != 1 or "DXB-B301" in answer.err
    again = space.dxb(*words)
    assert again.code == 0, again.err
    assert_recovers(space, WHERE[name], clean)

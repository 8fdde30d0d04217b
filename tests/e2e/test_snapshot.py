"""The build that does nothing: when its answer holds, and when everything is looked at."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from dextera_build.cli.main import main
from dextera_build.runs import snapshot
from dextera_build.store.state import State
from tests.e2e.space import Space

WORDS = ["build", "say/words", "--console", "none"]
SECRET = "correct-horse-battery"


@pytest.fixture
def built(space: Space, monkeypatch: pytest.MonkeyPatch) -> Space:
    for name in [name for name in os.environ if name.startswith("DXB_")]:
        monkeypatch.delenv(name)
    for name, value in space.environment().items():
        monkeypatch.setenv(name, value)
    monkeypatch.chdir(space.root)
    (space.root / "rules").rename(space.root / "shelf")
    (space.root / "rules").symlink_to("shelf")
    space.write("site/own.egg-info/PKG-INFO", "Version: 1\n")
    monkeypatch.setattr(sys, "path", [*sys.path, str(space.root / "site")])
    build()
    return space


def build() -> None:
    """Build until there is a snapshot: of what was written just now there is none."""
    for _ in range(5):
        time.sleep(0.05)
        assert main(WORDS) == 0
        if snapshot.answer(WORDS):
            return
    raise AssertionError("no snapshot was written")


def state(root: Path) -> State:
    return State(str(root / "cache/local/state.db"))


def entry_of_a_target(root: Path) -> Path:
    (row,) = state(root).all(snapshot.KIND).values()
    return Path(row.decode().rpartition("\0")[2])


def keeping(folder: Path, change: Callable[[], object]) -> None:
    """Change something, and give the folder back the time that it had, as `rsync -a` does."""
    before = folder.stat().st_mtime_ns
    change()
    os.utime(folder, ns=(before, before))


def switch(link: Path) -> None:
    """Let a link lead to a copy of the folder."""
    copy = shutil.copytree(link, link.with_name("copy"))
    link.unlink()
    link.symlink_to(copy)


def spoil(root: Path, how: Callable[[bytes], bytes]) -> None:
    rows = state(root).all(snapshot.KIND)
    state(root).put(snapshot.KIND, {name: how(row) for name, row in rows.items()})


CHANGES: dict[str, Callable[[Path], object]] = {
    "a rule's time stamp": lambda root: (root / "rules/toy/shout.py").touch(),
    "a new module": lambda root: (root / "rules/toy/new.py").write_text(""),
    "a new module, the time of its folder kept": lambda root: keeping(
        root / "rules/toy", (root / "rules/toy/newer.py").touch
    ),
    "a new module on the search path, the time of its folder kept": lambda root: keeping(
        root / "site", (root / "site/newer.py").touch
    ),
    "the version of a distribution": lambda root: keeping(
        root / "site/own.egg-info/PKG-INFO", lambda: (root / "site/own.egg-info/PKG-INFO").write_text("Version: 2\n")
    ),
    "the entry points of a distribution": (lambda root: (root / "site/own.egg-info/entry_points.txt").write_text("")),
    "a link": lambda root: switch(root / "rules"),
    "an output deleted": lambda root: (root / "cache/out/say/words/all/all").unlink(),
    "an output edited": lambda root: (root / "cache/out/say/words/all/all").write_text("x"),
    "an entry deleted": lambda root: entry_of_a_target(root).unlink(),
    "a setting": lambda root: (root / "dxb.local.toml").write_text('profile = "stub"\n'),
    "a user's setting": lambda root: Space(root).write(".config/dxb/config.toml", "jobs = 1\n"),
    "no state": lambda root: (root / "cache/local/state.db").unlink(),
    "a short state": lambda root: os.truncate(root / "cache/local/state.db", 5000),
    "a pin": lambda root: main(["build", "--lock", *WORDS[1:]]),
}


@pytest.mark.medium
def test_any_change_is_seen(built: Space, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, change in CHANGES.items():
        change(built.root)
        assert not snapshot.answer(WORDS), name
        build()
    monkeypatch.setenv("DXB_JOBS", "3")
    assert not snapshot.answer(WORDS)
    monkeypatch.delenv("DXB_JOBS")
    assert snapshot.answer(WORDS)


def test_bytes_that_were_edited_in_place_are_seen_by_their_times(built: Space) -> None:
    path = built.root / "cache/out/say/words/all/all"
    before, data = path.stat(), path.read_bytes()
    path.write_bytes(bytes([data[0] ^ 1]) + data[1:])
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert not snapshot.answer(WORDS)
    assert main(WORDS) == 0
    assert path.read_bytes() == data


def test_another_start_of_the_machine_is_looked_at(built: Space, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(snapshot, "_BOOT", str(built.write("boot", "another\n")))
    assert not snapshot.answer(WORDS)


def test_it_answers_as_the_build_did(built: Space, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert snapshot.answer(WORDS)
    told = capsys.readouterr()
    for _ in range(2):  # another command line
        assert main(["build", "say/words"]) == 0
        other = capsys.readouterr()
        assert told.out == other.out != ""
    assert told.err == ""
    assert other.err.startswith("say/words is up to date   7 nodes")
    assert not snapshot.answer(["plan", "say/words"])


def test_a_store_in_another_place_is_found_by_the_settings(built: Space, capsys: pytest.CaptureFixture[str]) -> None:
    built.write("dxb.toml", 'cache = "elsewhere"\n')
    for _ in range(3):
        time.sleep(0.05)
        capsys.readouterr()
        assert main(["build", "say/words"]) == 0
    assert capsys.readouterr().err.startswith("say/words is up to date")


@pytest.mark.medium
def test_the_request_that_was_answered_last_is_the_one_that_others_read(
    built: Space, capsys: pytest.CaptureFixture[str]
) -> None:
    other = [*WORDS, "--set", "start.text=three"]
    for _ in range(3):
        time.sleep(0.05)
        assert main(other) == 0
    values = set()
    for words in (WORDS, other, WORDS):
        assert snapshot.answer(words)
        capsys.readouterr()
        assert main(["get", "say/words:start"]) == 0
        values.add((tuple(words), capsys.readouterr().out))
    assert len(values) == 2


def test_paths_are_right_in_every_folder(
    built: Space, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def printed() -> list[Path]:
        capsys.readouterr()
        assert main(WORDS) == 0
        return [Path(line.partition("\t")[2]) for line in capsys.readouterr().out.splitlines()]

    assert all(not path.is_absolute() and path.exists() for path in printed())
    monkeypatch.chdir(built.root / "recipes")
    for _ in range(3):
        assert all(path.exists() for path in printed())
        time.sleep(0.05)
    monkeypatch.chdir(built.root)
    assert all(not path.is_absolute() and path.exists() for path in printed())


@pytest.mark.medium
def test_what_was_forced_or_refused_leaves_no_snapshot(built: Space) -> None:
    for words in (["--force", "all"], ["--locked"], ["--console", "jsonl"], ["--calls", "refresh"]):
        asked = ["build", "say/words", *words]
        for _ in range(2):
            main(asked)
            assert not snapshot.answer(asked), words


def test_only_so_many_are_kept(built: Space, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(snapshot, "_MOST", 2)
    for jobs in ("3", "4", "5"):
        assert main([*WORDS, "-j", jobs]) == 0
    assert len(state(built.root).all(snapshot.KIND)) == 2
    assert not snapshot.answer(WORDS)
    assert snapshot.answer([*WORDS, "-j", "5"])


def test_no_value_of_a_variable_is_written(built: Space, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DXB_REMOTE_TOKEN", SECRET)
    build()
    written = [path for path in built.root.rglob("*") if path.is_file()]
    assert written
    assert not [path for path in written if SECRET.encode() in path.read_bytes()]


@pytest.mark.medium
def test_it_loads_next_to_nothing(built: Space) -> None:
    program = "import sys; from dextera_build.cli.main import main; main(); print(*sys.modules)"
    words = [sys.executable, "-c", program, *WORDS]
    for _ in range(3):
        time.sleep(0.05)
        done = subprocess.run(words, capture_output=True, text=True, env=built.environment(), check=True)
    ours = {name for name in done.stdout.split() if name.startswith("dextera_build")}
    own = ("", ".version", ".cli", ".cli.main", ".cli.streams", ".runs", ".runs.snapshot")
    own += (".store", ".store.seen", ".store.state")
    assert ours == {f"dextera_build{name}" for name in own}
    assert {"json", "pathlib", "argparse"}.isdisjoint(done.stdout.split())

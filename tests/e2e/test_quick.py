"""The quickest build that does nothing: when it answers, and when it leaves the answer to others."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from dextera_build.cli import quick
from dextera_build.cli.main import main
from dextera_build.store import presence
from tests.e2e.space import Space

WORDS = ["build", "say/words", "--console", "none"]


@pytest.fixture
def built(space: Space, monkeypatch: pytest.MonkeyPatch) -> Space:
    for name in [name for name in os.environ if name.startswith("DXB_")]:
        monkeypatch.delenv(name)
    for name, value in space.environment().items():
        monkeypatch.setenv(name, value)
    monkeypatch.chdir(space.root)
    build()
    return space


def build() -> None:
    """Build until there is a note: what was written just now is looked at once more."""
    for _ in range(5):
        time.sleep(0.05)
        assert main(WORDS) == 0
        if quick.answer(WORDS):
            return
    raise AssertionError("no note was written")


def shard(root: Path) -> Path:
    return next(path for path in sorted((root / "cache/cas").glob("*/*")))


def note(root: Path) -> Path:
    return max((root / ".cache/dxb/local/quick").iterdir(), key=lambda path: path.stat().st_mtime_ns)


def flip(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


CHANGES: dict[str, Callable[[Path], object]] = {
    "a rule's time stamp": lambda root: (root / "rules/toy/shout.py").touch(),
    "a new module": lambda root: (root / "rules/toy/new.py").write_text(""),
    "an output deleted": lambda root: (root / "cache/out/say/words/all/all").unlink(),
    "an output edited": lambda root: (root / "cache/out/say/words/all/all").write_text("x"),
    "a blob deleted": lambda root: shard(root).unlink(),
    "a setting": lambda root: (root / "dxb.local.toml").write_text('profile = "stub"\n'),
    "a user's setting": lambda root: Space(root).write(".config/dxb/config.toml", "jobs = 1\n"),
    "no snapshot": lambda root: shutil.rmtree(root / "cache/local/snapshots"),
    "no note": lambda root: note(root).unlink(),
    "a pin": lambda root: main(["build", "--lock", *WORDS[1:]]),
    "a damaged note": lambda root: flip(note(root)),
    "a short note": lambda root: os.truncate(note(root), 3),
}


def test_any_change_is_left_to_others(built: Space, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, change in CHANGES.items():
        change(built.root)
        assert not quick.answer(WORDS), name
        build()
    monkeypatch.setenv("DXB_JOBS", "3")
    assert not quick.answer(WORDS)
    monkeypatch.delenv("DXB_JOBS")
    assert quick.answer(WORDS)


def test_a_machine_that_was_started_anew_is_looked_at(built: Space, monkeypatch: pytest.MonkeyPatch) -> None:
    boot = built.write("boot", "one\n")
    monkeypatch.setattr(presence, "BOOT", str(boot))
    (built.root / "cache/local/snapshots").rename(built.root / "old")
    build()
    boot.write_text("two\n")
    assert not quick.answer(WORDS)
    build()


def test_it_answers_as_the_build_did(built: Space, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert quick.answer(WORDS)
    told = capsys.readouterr()
    assert main(["build", "say/words"]) == 0  # another command line: looked up
    other = capsys.readouterr()
    assert told.out == other.out != ""
    assert told.err == ""
    assert other.err.startswith("say/words is up to date   7 nodes")
    assert not quick.answer(["plan", "say/words"])


def test_paths_are_right_wherever_one_stands(
    built: Space, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def printed() -> list[Path]:
        capsys.readouterr()
        assert main(WORDS) == 0
        return [Path(line.partition("\t")[2]) for line in capsys.readouterr().out.splitlines()]

    assert all(not path.is_absolute() and path.exists() for path in printed())
    monkeypatch.chdir(built.root / "recipes")
    for _ in range(3):  # from the snapshot, and from the note that this leaves
        assert all(path.exists() for path in printed())
        time.sleep(0.05)
    monkeypatch.chdir(built.root)
    assert all(not path.is_absolute() and path.exists() for path in printed())


def test_what_was_forced_or_refused_leaves_no_note(built: Space) -> None:
    for words in (["--force", "all"], ["--locked"], ["--console", "jsonl"], ["--calls", "refresh"]):
        asked = ["build", "say/words", *words]
        for _ in range(2):
            main(asked)
            assert not quick.answer(asked), words


def test_it_loads_next_to_nothing(built: Space) -> None:
    program = "import sys; from dextera_build.cli.main import main; main(); print(*sys.modules)"
    words = [sys.executable, "-c", program, *WORDS]
    for _ in range(3):
        time.sleep(0.05)
        done = subprocess.run(words, capture_output=True, text=True, env=built.environment(), check=True)
    ours = {name for name in done.stdout.split() if name.startswith("dextera_build")}
    assert ours == {
        f"dextera_build{name}" for name in ("", ".version", ".cli", ".cli.main", ".cli.quick", ".cli.streams")
    }
    assert "json" not in done.stdout.split()

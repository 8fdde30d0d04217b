"""Temporary folders: a command that ends leaves nothing there, and what a killed one left goes with the next build."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from dextera_build.cli import main
from tests.e2e.space import Space
from tests.interrupts import hear_interrupts

UNTIDY = '''
"""toy.untidy: leaves files."""
import tempfile
import time
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, Options, rule

class UntidyOptions(Options):
    """Options."""
    seconds: float = 0.0
    """How long to sleep [s]."""

@rule(version=1)
def untidy(ctx: Context, *, options: UntidyOptions) -> File:
    """Write where a library might."""
    (ctx.scratch / "file").write_text("text")
    tempfile.mkdtemp(prefix="library-")
    time.sleep(options.seconds)
    return File(data=b"done")
'''


@pytest.fixture
def untidy(space: Space) -> Space:
    space.write("rules/toy/untidy.py", UNTIDY.lstrip())
    space.write("recipes/g.yaml", "nodes:\n  a: {rule: toy.untidy}\ntargets: {default: [a]}\n")
    (space.root / "tmp").mkdir()
    return space


def left(space: Space) -> list[Path]:
    return list((space.root / "tmp").iterdir())


def start(space: Space, *words: str) -> tuple[subprocess.Popen[str], Path]:
    """Begin a command, and wait until its rule has written files; returns the folder in which they are."""
    before = left(space)
    process = subprocess.Popen(
        [sys.executable, "-m", "dextera_build", *words, "--set", "a.seconds=600"],
        cwd=space.root,
        env=space.environment(TMPDIR=str(space.root / "tmp")),
        text=True,
        stderr=subprocess.DEVNULL,
        preexec_fn=hear_interrupts(),
    )
    while True:
        assert process.poll() is None
        time.sleep(0.05)
        for folder in left(space):
            if folder not in before and list(folder.glob("library-*")):
                return process, folder


@pytest.mark.medium
def test_a_build_that_ends_leaves_no_temporary_file(untidy: Space) -> None:
    answer = untidy.dxb("build", "g", env={"TMPDIR": str(untidy.root / "tmp")})
    assert (answer.code, left(untidy)) == (0, []), answer.err


@pytest.mark.medium
def test_what_a_killed_build_left_goes_with_the_next_and_what_runs_stays(untidy: Space) -> None:
    killed, first = start(untidy, "build", "g")
    killed.kill()
    killed.wait()
    assert left(untidy) == [first]
    running, second = start(untidy, "build", "g")
    assert left(untidy) == [second]
    assert untidy.dxb("build", "g", env={"TMPDIR": str(untidy.root / "tmp")}).code == 0
    assert left(untidy) == [second]
    assert len(list(second.iterdir())) == 2
    running.send_signal(signal.SIGINT)
    assert running.wait(60) == 130
    assert left(untidy) == []


@pytest.mark.slow
def test_a_killed_watch_leaves_no_more(untidy: Space) -> None:
    watch, folder = start(untidy, "watch", "g")
    child = Path(f"/proc/{watch.pid}/task/{watch.pid}/children").read_text().split()[0]
    watch.kill()
    watch.wait()
    os.kill(int(child), signal.SIGKILL)
    assert left(untidy) == [folder]
    assert untidy.dxb("build", "g", env={"TMPDIR": str(untidy.root / "tmp")}).code == 0
    assert left(untidy) == []


def test_the_traceback_of_a_fault_replaces_the_last_one(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    for text in ("one", "other"):
        assert main._fault(ZeroDivisionError(text), ["build"]) == 70
        assert str(tmp_path / "dxb/fault.txt") in capsys.readouterr().err
    assert [path.name for path in (tmp_path / "dxb").iterdir()] == ["fault.txt"]
    assert (tmp_path / "dxb/fault.txt").read_text().startswith("dxb ")


def test_a_fault_that_cannot_be_written_is_printed(tmp_path, monkeypatch, capsys) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert main._fault(ZeroDivisionError("text"), ["build"]) == 70
    assert capsys.readouterr().err.startswith("dxb ")

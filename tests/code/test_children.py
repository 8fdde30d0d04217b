"""Python processes that a rule starts run the code that the build digested, whatever byte code lies about."""

from __future__ import annotations

import os
import py_compile
from pathlib import Path

import pytest

from dextera_build.code.modules import PACKAGE
from tests.e2e.space import Space

RULE = '''
"""toy.ask: lets another process work."""
import multiprocessing
import subprocess
import sys
import time
from pathlib import Path

from dextera_build.artifacts.base import File
from dextera_build.rule import Context, Options, rule
from labs_of_children.work import work


class AskOptions(Options):
    """Options."""

    how: str = ""
    """How the process starts."""


@rule(version=1)
def ask(ctx: Context, *, options: AskOptions) -> File:
    """Return its answer."""
    here = Path(__file__).parents[2]
    (here / "began").touch()
    while (here / "wait").exists():
        time.sleep(0.01)
    if options.how == "subprocess":
        words = "from labs_of_children.work import work; print(work(1), end='')"
        return File(data=subprocess.run([sys.executable, "-c", words], stdout=subprocess.PIPE, check=True).stdout)
    with multiprocessing.get_context(options.how).Pool(1) as pool:
        return File(data=b"%d" % pool.map(work, [1])[0])
'''
WAYS = ("spawn", "forkserver", "subprocess")


@pytest.fixture
def space(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Space:
    monkeypatch.delenv("PYTHONDONTWRITEBYTECODE", raising=False)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(PACKAGE.parent), str(tmp_path / "src")]))
    made = Space(tmp_path)
    made.write("dxb.toml", 'cache = "cache"\n')
    made.write("rules/toy/ask.py", RULE.lstrip())
    made.write("src/labs_of_children/__init__.py", "")
    made.write("src/labs_of_children/work.py", "def work(x):\n    return 3 * x\n")
    nodes = "\n".join(f"  {way}: {{rule: toy.ask, how: {way}}}" for way in WAYS)
    made.write("recipes/g.yaml", f"nodes:\n{nodes}\ntargets: {{default: [{', '.join(WAYS)}]}}\n")
    return made


def answers(space: Space) -> list[str]:
    return [(space.root / f"cache/out/g/{way}/{way}").read_text() for way in WAYS]


@pytest.mark.medium
def test_byte_code_of_the_same_size_and_time_is_not_run(space: Space) -> None:
    work = space.root / "src/labs_of_children/work.py"
    py_compile.compile(str(work))
    before = work.stat().st_mtime_ns
    space.edit("src/labs_of_children/work.py", "3", "5")
    os.utime(work, ns=(before, before))
    built = space.dxb("build", "g", "--console", "none")
    assert built.code == 0, built.err
    assert answers(space) == ["5", "5", "5"]


@pytest.mark.slow
def test_code_that_is_edited_while_the_build_runs_is_not_run(space: Space) -> None:
    space.write("wait", "")
    building = space.start("build", "g", "--console", "none")
    while not (space.root / "began").exists():
        assert building.poll() is None, building.communicate()
    space.edit("src/labs_of_children/work.py", "3", "5")
    (space.root / "wait").unlink()
    _, said = building.communicate()
    assert building.returncode == 0, said
    assert answers(space) == ["3", "3", "3"]

"""Rules that find out for themselves what they read, through the real `dxb`."""

from __future__ import annotations

import shutil
import time

import pytest

from tests.e2e.space import Answer, Space

FLAT = '''
"""toy.flat: a text with all that it includes, and the names of the parts beside it."""
import posixpath
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, Options, rule

class FlatOptions(Options):
    """Options."""
    path: str = "robots/arm.txt"
    """Where to begin."""

@rule(version=1, discovers=True)
def flat(ctx: Context, *, options: FlatOptions) -> File:
    """Return the text."""
    return File(data="\\n".join(lines(ctx, options.path)).encode())

def lines(ctx: Context, path: str) -> list[str]:
    """Of a file, with what it includes in place."""
    found = []
    for line in ctx.read(path).decode().splitlines():
        word, _, name = line.partition(" ")
        at = posixpath.join(posixpath.dirname(path), name)
        if word == "include":
            found += lines(ctx, at)
        elif word == "all":
            found += ctx.glob(at)
        elif word == "maybe":
            found += [name if ctx.exists(at) else "no " + name]
        else:
            found.append(line)
    return found
'''
SLY = '''
"""toy.sly: reads without saying so."""
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, rule

@rule(version=1)
def sly(ctx: Context) -> File:
    """Return what it read."""
    return File(data=ctx.read("robots/arm.txt"))
'''
RECIPE = """
nodes:
  text: {rule: toy.flat}
  other: {rule: toy.flat, path: robots/other.txt}
  sly: {rule: toy.sly}
targets:
  default: [text, other]
"""


@pytest.fixture
def robot(space: Space) -> Space:
    space.write("rules/toy/flat.py", FLAT.lstrip())
    space.write("rules/toy/sly.py", SLY.lstrip())
    space.write("recipes/robot.yaml", RECIPE)
    space.write("robots/arm.txt", "arm\ninclude link.txt\nall meshes/*.stl\nmaybe extra.txt\n")
    space.write("robots/link.txt", "link\n")
    space.write("robots/meshes/a.stl", "a")
    space.write("robots/other.txt", "other\n")
    rest()
    answer = space.dxb("build", "robot")
    assert answer.code == 0, answer.err
    return space


def rest() -> None:
    """Stamps of files that were written before must lie in the past."""
    time.sleep(0.06)


def text(space: Space) -> list[str]:
    return (space.root / "cache/out/robot/text/text").read_text().splitlines()


def ran(space: Space) -> set[str]:
    rest()
    answer = space.build("robot")
    assert answer.code == 0, answer.err
    return answer.nodes("ran")


def quick(space: Space) -> Answer:
    """A build that may take the short ways, which one with a log of events does not."""
    rest()
    return space.dxb("build", "robot")


@pytest.mark.medium
def test_what_was_read_makes_it_stale_and_why_names_it(robot: Space) -> None:
    assert text(robot) == ["arm", "link", "robots/meshes/a.stl", "no extra.txt"]
    assert "robot is up to date" in quick(robot).err
    robot.write("robots/link.txt", "another link\n")
    why = robot.dxb("why", "robot:text").out
    assert "1 thing it depends on changed" in why
    assert "read\trobots/link.txt\t" in why
    answer = quick(robot)
    assert "1 ran, 1 cached" in answer.err
    assert text(robot)[1] == "another link"
    robot.write("robots/link.txt", "link\n")
    assert "ran" not in quick(robot).err  # the branch before
    assert text(robot)[1] == "link"
    shown = robot.dxb("show", "robot:text").out
    assert "read robots/link.txt\tsha256 " in shown
    assert "read glob robots/meshes/*.stl\t1 file\n" in shown
    assert "read exists robots/extra.txt\tno\n" in shown
    assert "read robots/link.txt\tsha256 " in robot.dxb("show", "robot:text", "--lineage").out
    assert robot.dxb("build", "robot", "--check").code == 0


@pytest.mark.slow
def test_files_that_come_and_go(robot: Space) -> None:
    robot.write("robots/meshes/b.stl", "b")
    assert "file\trobots/meshes/b.stl\tadded" in robot.dxb("why", "robot:text").out
    assert robot.dxb("build", "robot", "--check").code == 3
    assert "1 ran, 1 cached" in quick(robot).err
    assert text(robot)[2:4] == ["robots/meshes/a.stl", "robots/meshes/b.stl"]
    (robot.root / "robots/meshes/b.stl").unlink()
    robot.write("robots/extra.txt", "")
    assert "read\texists robots/extra.txt\tno -> yes" in robot.dxb("why", "robot:text").out
    assert "1 ran, 1 cached" in quick(robot).err
    assert text(robot)[-1] == "extra.txt"
    (robot.root / "robots/arm.txt").touch()
    robot.write("robots/notes.txt", "nobody reads this")
    assert "robot is up to date" in quick(robot).err
    (robot.root / "robots/link.txt").unlink()
    answer = quick(robot)
    assert answer.code == 1
    assert "DXB-B352" in answer.err
    assert "`robots/link.txt`" in answer.err


@pytest.mark.medium
def test_another_checkout_fetches_it(robot: Space) -> None:
    share = robot.root / "share"
    assert robot.dxb("cache", "push", "robot", "--to", str(share)).code == 0
    copy = Space(robot.root / "copy")
    for name in ("rules", "recipes", "robots", "dxb.toml"):
        source = robot.root / name
        if source.is_dir():
            shutil.copytree(source, copy.root / name)
        else:
            shutil.copy(source, copy.root / name)
    answer = copy.dxb("cache", "pull", "robot", "--from", str(share))
    assert answer.code == 0, answer.err
    assert text(copy) == text(robot)
    assert ran(copy) == set()
    copy.write("robots/link.txt", "another\n")
    assert ran(copy) == {"text"}


def test_one_that_does_not_declare_it_is_told(robot: Space) -> None:
    answer = robot.dxb("build", "robot:sly")
    assert answer.code == 1
    assert "DXB-B350" in answer.err
    assert "discovers=True" in answer.err


def test_the_lock_file_and_the_check_know_what_was_read(robot: Space) -> None:
    assert robot.dxb("build", "robot", "--lock").code == 0
    assert robot.dxb("check", "robot:text").code == 0
    robot.write("robots/link.txt", "another link\n")
    refused = robot.dxb("build", "robot", "--locked")
    assert refused.code == 3
    assert "robots/link.txt" in refused.err
    assert "DXB-C104" in robot.dxb("check", "robot:text").err
    robot.write("robots/link.txt", "link\n")
    assert robot.dxb("build", "robot", "--locked").code == 0

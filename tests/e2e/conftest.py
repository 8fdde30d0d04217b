"""A project of small rules, for the real `dxb`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.e2e.machines import serving
from tests.e2e.space import Space
from tests.recipe.conftest import RECIPE, RULES

SLOW = '''
"""toy.slow: sleeps, and can be told to misbehave."""
import os
import signal
import time
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, Options, rule

class SlowOptions(Options):
    """Options."""
    seconds: float = 0.0
    """How long to sleep [s]."""
    do: str = "work"
    """What to do."""

@rule(version=1)
def slow(ctx: Context, text: File, *, options: SlowOptions) -> File:
    """Return the text."""
    print("printed", options.do, flush=True)
    time.sleep(options.seconds)
    if options.do == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    if options.do == "raise":
        raise ZeroDivisionError("by hand")
    ctx.check(options.do != "fail", "the text is wrong", hint="set `do` to `work`", length=len(text.data))
    ctx.say(f"{len(text.data)} bytes")
    return text
'''

MUL = '''
"""toy.mul: counts."""
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, Options, rule

class MulOptions(Options):
    """Options."""
    add: int = 0
    """What to add."""

@rule(version=1)
def mul(ctx: Context, text: File, *, options: MulOptions) -> File:
    """Multiply by three."""
    return File(data=b"%d" % (int(text.data) * 3 + options.add))
'''
NODES = 12


@pytest.fixture
def space(tmp_path: Path) -> Space:
    return small_project(tmp_path)


def small_project(root: Path) -> Space:
    """The project of small rules in a folder."""
    made = Space(root)
    made.write("dxb.toml", 'cache = "cache"\n')
    for name, text in {**RULES, "toy/slow.py": SLOW}.items():
        made.write(f"rules/{name}", text.lstrip())
    made.write("recipes/say/words.yaml", RECIPE)
    return made


@pytest.fixture(scope="session")
def asked(tmp_path_factory: pytest.TempPathFactory) -> Space:
    """The project after one build of `say/words`, for all tests that only ask: nothing is edited or built in it."""
    made = small_project(tmp_path_factory.mktemp("asked"))
    answer = made.build("say/words")
    assert answer.code == 0, answer.err
    return made


@pytest.fixture
def served(space: Space) -> Iterator[str]:
    """`dxb cache serve` as a process."""
    with serving(space, "served") as url:
        yield url


@pytest.fixture
def counts(space: Space) -> Space:
    space.write("rules/toy/mul.py", MUL.lstrip())
    space.write("data", "1")
    nodes = "".join(f"  a{number}: {{rule: toy.mul, text: $l}}\n" for number in range(NODES))
    names = ", ".join(f"a{number}" for number in range(NODES))
    space.write("recipes/g.yaml", f"inputs: {{l: data}}\nnodes:\n{nodes}targets: {{default: [{names}]}}\n")
    return space

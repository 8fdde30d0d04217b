"""A project with small rules of its own."""

from __future__ import annotations

from pathlib import Path

import pytest

from dextera_build.project.project import Project
from tests.e2e.space import Space as RealSpace

RULES = {
    "toy/start.py": '''
"""toy.start: where it begins."""
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, Options, rule

class StartOptions(Options):
    """Options."""
    text: str = "hello"
    """What to say."""
    sizes_m: tuple[float, ...] = (1.0,)
    """Sizes [m]."""

@rule(version=1)
def start(ctx: Context, *, options: StartOptions) -> File:
    """Return the text."""
    return File(data=options.text.encode())
''',
    "toy/split.py": '''
"""toy.split: a collection."""
from dextera_build.artifacts.base import Collection, File
from dextera_build.rule import Context, rule

@rule(version=1)
def split(ctx: Context, text: File) -> Collection[File]:
    """Return one file a word."""
    return Collection[File](items={word.decode(): File(data=word) for word in text.data.split()})
''',
    "toy/shout.py": '''
"""toy.shout: louder."""
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, Options, rule
from .marks import mark

class ShoutOptions(Options):
    """Options."""
    times: int = 1
    """How many marks."""

@rule(version=1)
def shout(ctx: Context, text: File, more: File | None = None, *, options: ShoutOptions) -> File:
    """Return the text in capitals."""
    return File(data=text.data.upper() + mark(options.times))
''',
    "toy/marks.py": '''
"""Marks."""

def mark(times):
    """Exclamation marks."""
    return b"!" * times
''',
    "toy/join.py": '''
"""toy.join: one of many."""
from dextera_build.artifacts.base import Collection, File
from dextera_build.rule import Context, rule

@rule(version=1)
def join(ctx: Context, texts: Collection[File]) -> File:
    """Return all texts."""
    return File(data=b" ".join(part.data for part in texts.items.values()))
''',
    "toy/spoken.py": '''
"""toy.spoken: a rule with backends."""
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, rule

@rule(version=1)
def spoken(ctx: Context, text: File) -> File:
    """Return the text as spoken."""
    return ctx.backend.speak(text)
''',
    "toy/spoken_quiet.py": '''
"""Quiet."""
from dextera_build.rule import Backend
BACKEND = Backend(summary="quietly", profiles=("cpu", "stub"))
def speak(text):
    return text
''',
    "toy/spoken_cloud.py": '''
"""Not installable."""
from dextera_build.rule import Backend
BACKEND = Backend(summary="far away", profiles=("cloud",), packages=("no-such-distribution",), extra="models")
''',
}
RECIPE = """summary: Words, louder.
nodes:
  start: {rule: toy.start, text: one two}
  words: {rule: toy.split, text: $start}
  word:
    each: $words
    as: word
    nodes:
      loud: {rule: toy.shout, text: $word}
      louder: {rule: toy.shout, text: $loud, times: 2}
  all: {rule: toy.join, texts: $word.louder}
targets:
  default: [all]
"""


class Space(RealSpace):
    """A project folder that plans are made in, without the command line."""

    def project(self) -> Project:
        return Project(self.root)


@pytest.fixture
def space(tmp_path: Path) -> Space:
    made = Space(tmp_path)
    made.write("dxb.toml", "")
    for name, text in RULES.items():
        made.write(f"rules/{name}", text.lstrip())
    made.write("recipes/say/words.yaml", RECIPE)
    return made

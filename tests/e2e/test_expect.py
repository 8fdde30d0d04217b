"""`expect:` of a recipe through the real `dxb`."""

from __future__ import annotations

import pytest

from tests.e2e.space import Space

SIZED = '''
"""toy.sized: a word with its size."""
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, rule

@rule(version=1)
def sized(ctx: Context, text: File) -> File:
    """Return the text."""
    ctx.metric("Letters", len(text.data), "of 3")
    ctx.metric("Letters, low", len(text.data) - 1)
    ctx.metric("Letters, high", len(text.data) + 1)
    return text
'''
RECIPE = """nodes:
  start: {rule: toy.start, text: one two}
  words: {rule: toy.split, text: $start}
  word:
    each: $words
    as: word
    nodes:
      sized: {rule: toy.sized, text: $word}
targets: {default: [word.sized]}
"""
BOUNDS = """expect:
  word[*].sized.letters: '== all'
  word[one].sized.letters: '>= %d'
"""


@pytest.fixture
def bounded(space: Space) -> Space:
    space.write("rules/toy/sized.py", SIZED.lstrip())
    space.write("recipes/say/sized.yaml", RECIPE + BOUNDS % 2)
    return space


def test_check_compares_what_is_built_with_its_bounds(bounded: Space) -> None:
    early = bounded.dxb("check", "say/sized")
    assert early.code == 3
    assert "error[DXB-C105]: bounds of `say/sized` cannot be checked: 1 node not built" in early.err
    assert "hint: `dxb build say/sized`" in early.err
    assert bounded.dxb("build", "say/sized").code == 0
    answer = bounded.dxb("check", "say/sized")
    assert answer.code == 0
    assert answer.out.splitlines() == [
        "say/sized\tsound, 3 calls, 3 of 3 bounds hold",
        "word[one].sized.Letters\t3 of 3\t2 to 4\t== all\tok",
        "word[two].sized.Letters\t3 of 3\t2 to 4\t== all\tok",
        "word[one].sized.Letters\t3 of 3\t2 to 4\t>= 2\tok",
    ]
    first = bounded.dxb("check", "say/sized", "--json").rows[0]["bounds"][0]
    assert (first["node"], first["value"], first["interval"], first["ok"]) == ("word[one].sized", 3.0, [2.0, 4.0], True)


@pytest.mark.medium
def test_a_missed_bound_fails_the_check_alone(bounded: Space) -> None:
    assert bounded.dxb("build", "say/sized").code == 0
    bounded.write("recipes/say/sized.yaml", RECIPE + BOUNDS % 5)
    assert bounded.build("say/sized").nodes("ran") == set()  # bounds are in no key
    answer = bounded.dxb("check", "say/sized")
    assert answer.code == 1
    assert "word[one].sized.Letters\t3 of 3\t2 to 4\t>= 5\tMISSED" in answer.out
    assert "error[DXB-B405]: `say/sized` misses 1 bound of 3" in answer.err
    assert "recipes/say/sized.yaml:12:3" in answer.err
    assert "expected >= 5" in answer.err
    page = (bounded.root / bounded.dxb("report", "say/sized").out.strip()).read_text()
    assert page.count("✓ holds") == 2
    assert page.count("✗ missed") == 1
    stub = bounded.dxb("check", "say/sized", "--profile", "stub")
    assert stub.code == 0
    assert "2 bounds not compared: profile `stub` makes stand-ins" in stub.out

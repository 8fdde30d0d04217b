"""Large content through the whole of `dxb`: as an input, from a rule, into a rule, out to a file, in little memory."""

from __future__ import annotations

import resource

import pytest

from tests.e2e.space import Space

GIB = 1 << 30
MOST_MIB = 400

RULE = '''
"""toy.big: hands a file on without reading it whole."""
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, rule

@rule(version=1)
def big(ctx: Context, seen: File) -> File:
    """Return the file with one byte more."""
    target = ctx.scratch / "more"
    with seen.open() as source, target.open("wb") as file:
        while chunk := source.read(1 << 20):
            file.write(chunk)
        file.write(b"!")
    return File.of(target)
'''

RECIPE = """inputs: {source: source.bin}
nodes:
  first: {rule: toy.big, seen: $source}
  second: {rule: toy.big, seen: $first}
targets: {default: [second]}
"""


@pytest.mark.slow
def test_a_gibibyte_goes_through_two_rules_in_little_memory(space: Space) -> None:
    space.write("rules/toy/big.py", RULE.lstrip())
    space.write("recipes/say/big.yaml", RECIPE)
    with (space.root / "source.bin").open("wb") as file:
        file.truncate(GIB)
    answer = space.dxb("build", "say/big")
    assert answer.code == 0, answer.err
    (_, _, path) = answer.out.strip().partition("\t")
    assert (space.root / path).stat().st_size == GIB + 2
    # The most that any process of the build held, workers included.
    assert resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024 < MOST_MIB

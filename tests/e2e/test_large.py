"""Large content through the whole of `dxb`: into rules, out to files, to remotes and back, in little memory.

`DXB_LARGE_GIB` sets how large it is [GiB]; four times as much has to fit on the disk.
"""

from __future__ import annotations

import os
import resource
import shutil

import pytest

from dextera_build import digest
from tests.e2e.machines import serving
from tests.e2e.space import Answer, Space

GIB = 1 << 30
SIZE = int(float(os.environ.get("DXB_LARGE_GIB", "1")) * GIB)
PATIENCE_S = 300.0 * max(1.0, SIZE / GIB)
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

pytestmark = [pytest.mark.slow, pytest.mark.timeout(8 * PATIENCE_S)]


@pytest.fixture
def large(space: Space) -> Space:
    """A recipe that reads a large file."""
    space.write("rules/toy/big.py", RULE.lstrip())
    space.write("recipes/say/big.yaml", RECIPE)
    with (space.root / "source.bin").open("wb") as file:
        file.truncate(SIZE)
    return space


def dxb(space: Space, *words: str, store: str = "cache") -> Answer:
    answer = space.dxb(*words, env={"DXB_CACHE": store}, timeout_s=PATIENCE_S)
    assert answer.code == 0, answer.err
    return answer


def most_mib() -> float:
    """The most that any process held that ended by now, workers and servers included [MiB]."""
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024


def test_large_content_goes_through_two_rules_in_little_memory(large: Space) -> None:
    (_, _, path) = dxb(large, "build", "say/big").out.strip().partition("\t")
    assert (large.root / path).stat().st_size == SIZE + 2
    assert most_mib() < MOST_MIB


def test_large_content_travels_in_little_memory(large: Space) -> None:
    (_, _, path) = dxb(large, "build", "say/big:first").out.strip().partition("\t")
    made = digest.of_file(large.root / path)
    shutil.rmtree(large.root / "cache" / "out")
    dxb(large, "push", "say/big:first", "--to", "./share")
    shutil.rmtree(large.root / "share")
    with serving(large, "served") as url:
        dxb(large, "push", "say/big:first", "--to", url)
        shutil.rmtree(large.root / "cache")
        (_, _, path) = dxb(large, "pull", "say/big:first", "--from", url, store="two").out.strip().partition("\t")
    assert digest.of_file(large.root / path) == made
    assert most_mib() < MOST_MIB

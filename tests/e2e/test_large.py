"""Large content through the whole of `dxb`: into rules, out to files, to remotes and back, in little memory.

`DXB_LARGE_GIB` sets how large it is [GiB]; four times as much has to fit on the disk.
"""

from __future__ import annotations

import multiprocessing
import os
import resource
import shutil
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor

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


def most_mib(work: Callable[[Space], None], space: Space) -> float:
    """The most that any process of `work` held, workers and servers included [MiB]."""
    # In a process of its own, which has no other children than these.
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(_measured, work, space).result()


def _measured(work: Callable[[Space], None], space: Space) -> float:
    work(space)
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024


def through_two_rules(space: Space) -> None:
    (_, _, path) = dxb(space, "build", "say/big").out.strip().partition("\t")
    assert (space.root / path).stat().st_size == SIZE + 2


def there_and_back(space: Space) -> None:
    (_, _, path) = dxb(space, "build", "say/big:first").out.strip().partition("\t")
    made = digest.of_file(space.root / path)
    shutil.rmtree(space.root / "cache" / "out")
    dxb(space, "cache", "push", "say/big:first", "--to", "./share")
    shutil.rmtree(space.root / "share")
    with serving(space, "served") as url:
        dxb(space, "cache", "push", "say/big:first", "--to", url)
        shutil.rmtree(space.root / "cache")
        (_, _, path) = (
            dxb(space, "cache", "pull", "say/big:first", "--from", url, store="two").out.strip().partition("\t")
        )
    assert digest.of_file(space.root / path) == made


def test_large_content_goes_through_two_rules_in_little_memory(large: Space) -> None:
    assert most_mib(through_two_rules, large) < MOST_MIB


def test_large_content_travels_in_little_memory(large: Space) -> None:
    assert most_mib(there_and_back, large) < MOST_MIB

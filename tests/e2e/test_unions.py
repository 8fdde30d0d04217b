"""Rules that take and return unions of artifact types."""

from __future__ import annotations

import pytest

PLY = '''
"""toy.ply: a mesh, or why there is none."""
import numpy as np
from dextera_build.artifacts.base import Collection, File
from dextera_build.artifacts.shapes.mesh import Hull
from dextera_build.rule import Context, Options, rule

class PlyOptions(Options):
    """Options."""
    points: int = 4
    """Number of points."""

@rule(version=1)
def ply(ctx: Context, *, options: PlyOptions) -> Hull | File:
    """Return points, or a text if there are none."""
    if not options.points:
        return File(data=b"none")
    return Hull(vertices=np.ones((options.points, 3), np.float32))
'''
COUNT = '''
"""toy.count: how many points came."""
from dextera_build.artifacts.base import Collection, File
from dextera_build.artifacts.shapes.mesh import Hull
from dextera_build.rule import Context, rule

@rule(version=1)
def count(ctx: Context, one: File | Hull, more: Collection[Hull | File] | None = None) -> File:
    """Count the points of all inputs."""
    parts = [one, *(more.items.values() if more else ())]
    return File(data=b" ".join(b"%d" % len(part.vertices) if isinstance(part, Hull) else part.data for part in parts))
'''
RECIPE = """inputs: {}
nodes:
  some: {rule: toy.ply}
  none: {rule: toy.ply, points: 0}
  counts: {rule: toy.count, one: $some, more: {a: $none, b: $some}}
  again: {rule: toy.count, one: $counts}
targets: {default: [counts, again, some, none]}
"""


@pytest.fixture
def unions(space):
    space.write("rules/toy/ply.py", PLY.lstrip())
    space.write("rules/toy/count.py", COUNT.lstrip())
    space.write("recipes/u.yaml", RECIPE)
    return space


def test_the_stored_type_decides_what_a_rule_gets(unions):
    answer = unions.build("u")
    assert answer.code == 0, answer.err
    out = unions.root / "cache/out/u"
    assert (out / "counts/counts").read_bytes() == b"4 none 4"
    assert (out / "again/again").read_bytes() == b"4 none 4"
    assert (out / "none/none").read_bytes() == b"none"
    assert [path.name for path in (out / "some").iterdir()] == ["some.npz"]
    assert "type\tHull" in unions.dxb("show", "u:some").out
    assert "input\tmore\tCollection[Hull | File]\t" in unions.dxb("show", "toy.count").out


def test_types_are_compared_before_the_build(unions):
    unions.edit("recipes/u.yaml", "one: $counts", "one: $some.vertices")
    answer = unions.build("u")
    assert answer.code == 2
    assert "File has no `vertices`" in answer.err
    unions.write("rules/toy/only.py", COUNT.lstrip().replace("count", "only").replace("one: File | Hull", "one: Hull"))
    unions.write("recipes/u.yaml", RECIPE.replace("again: {rule: toy.count", "again: {rule: toy.only"))
    answer = unions.build("u")
    assert answer.code == 2
    assert "`one` takes Hull, but `$counts` is File" in answer.err


def test_a_union_that_cannot_be_read_back_is_refused(unions):
    unions.edit("rules/toy/count.py", "one: File | Hull", "one: Collection[File] | Collection[Hull]")
    answer = unions.build("u")
    assert answer.code != 0
    assert "DXB-A114" in answer.err
    assert "`one` cannot be read back: two of its types are stored as `Collection`" in answer.err
    assert "rules/toy/count.py:" in answer.err

"""Geometry in the file formats of the field, through `dxb get` and `dxb show`."""

from __future__ import annotations

import pytest

from dextera_build.artifacts.spatial.point_cloud import PointCloud

CLOUD = '''
"""toy.cloud: the corners of a cube."""
import numpy as np
from dextera_build.artifacts.spatial.point_cloud import PointCloud
from dextera_build.rule import Context, rule

@rule(version=1, packages=("numpy",))
def cloud(ctx: Context) -> PointCloud:
    """Return eight points."""
    points = np.stack(np.meshgrid(*3 * [[0.0, 1.0]]), axis=-1).reshape(-1, 3).astype(np.float32)
    return PointCloud(points=points, frame="world")
'''
RECIPE = """inputs: {}
nodes:
  seen: {rule: toy.cloud}
targets: {default: [seen]}
"""


@pytest.fixture
def shapes(space):
    space.write("rules/toy/cloud.py", CLOUD.lstrip())
    space.write("recipes/shapes.yaml", RECIPE)
    answer = space.build("shapes")
    assert answer.code == 0, answer.err
    return space


def test_a_target_is_exported_in_its_format(shapes):
    assert len(PointCloud.load(shapes.root / "cache/out/shapes/seen/seen.ply").points) == 8


def test_get_writes_the_file_that_is_named(shapes):
    answer = shapes.dxb("get", "shapes:seen", "-o", "there/cube.ply")
    assert answer.out == "there/cube.ply\n"
    assert PointCloud.load(shapes.root / "there/cube.ply").frame == "world"
    assert shapes.dxb("get", "shapes:seen", "-o", "there").out == "there/seen.ply\n"


def test_get_names_the_formats_of_the_type(shapes):
    answer = shapes.dxb("get", "shapes:seen", "-o", "cube.obj")
    assert answer.code == 2
    assert "error[DXB-U220]: PointCloud cannot be written as `cube.obj`" in answer.err
    assert "one file   .ply" in answer.err
    assert "hint: `-o cube.obj/` writes a folder" in answer.err
    assert not (shapes.root / "cube.obj").exists()


def test_a_folder_may_have_a_dot_in_its_name(shapes):
    (shapes.root / "cube.d").mkdir()
    assert shapes.dxb("get", "shapes:seen", "-o", "cube.d").out == "cube.d/seen.ply\n"


def test_show_tells_the_frame(shapes):
    out = shapes.dxb("show", "shapes:seen").out
    assert "type\tPointCloud" in out
    assert 'field frame\t"world"' in out
    assert "field points\tfloat32 (8, 3)" in out

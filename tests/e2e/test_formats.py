"""Geometry in the file formats of the field, through `dxb get` and `dxb show`."""

from __future__ import annotations

import shutil

import pytest

from dextera_build.artifacts.spatial.point_cloud import PointCloud
from dextera_build.code.loader import PACKAGE

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
WRITTEN = '''
"""toy.written: points as PLY."""
from dextera_build.artifacts.base import File
from dextera_build.artifacts.spatial.point_cloud import PointCloud
from dextera_build.formats import point_cloud
from dextera_build.rule import Context, rule

@rule(version=1)
def written(ctx: Context, points: PointCloud) -> File:
    """Write a file."""
    point_cloud.save(points, ctx.scratch / "a.ply")
    return File.of(ctx.scratch / "a.ply")
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
    assert "hint: `-o cube/` writes a folder" in answer.err
    assert not (shapes.root / "cube.obj").exists()


def test_a_folder_may_have_a_dot_in_its_name(shapes):
    (shapes.root / "cube.d").mkdir()
    assert shapes.dxb("get", "shapes:seen", "-o", "cube.d").out == "cube.d/seen.ply\n"


def test_show_tells_the_frame(shapes):
    out = shapes.dxb("show", "shapes:seen").out
    assert "type\tPointCloud" in out
    assert 'field frame\t"world"' in out
    assert "field points\tfloat32 (8, 3)" in out


def test_a_rule_that_saves_without_naming_the_format_is_refused(shapes):
    shapes.write("rules/toy/written.py", WRITTEN.lstrip().replace("point_cloud.save(points, ", "points.save("))
    shapes.edit("recipes/shapes.yaml", "targets:", "  file: {rule: toy.written, points: $seen}\ntargets:")
    answer = shapes.build("shapes:file")
    assert answer.code == 1
    assert "a rule called `PointCloud.save`, whose code is not in the rule's key" in answer.err


@pytest.mark.slow
def test_an_edited_writer_makes_stale_what_writes_and_not_what_uses_the_type(space):
    own = shutil.copytree(PACKAGE, space.root / "dextera_build", ignore=shutil.ignore_patterns("docs", "__pycache__"))
    space.write("recipes/profile/bare.yaml", "{}\n")
    space.write("rules/toy/cloud.py", CLOUD.lstrip())
    space.write("rules/toy/written.py", WRITTEN.lstrip())
    space.write("recipes/shapes.yaml", RECIPE.replace("targets", "  file: {rule: toy.written, points: $seen}\ntargets"))
    assert space.run("build", "shapes:seen", "shapes:file", "--profile", "bare").code == 0

    def stale() -> list[str]:
        lines = space.run("ls", "--stale", "--profile", "bare", "shapes").out.splitlines()
        return [line.split()[0] for line in lines]

    assert stale() == []
    space.edit(own / "previews/text.py", "_LONGEST = 110", "_LONGEST = 90")
    space.edit(own / "formats/registry.py", '("table", (".csv",))', '("table", (".csv", ".tsv"))')
    assert stale() == []
    space.edit(own / "formats/point_cloud.py", "    return [path]", "    return list([path])")
    assert stale() == ["shapes:file"]

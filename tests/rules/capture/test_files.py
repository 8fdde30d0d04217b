"""capture.mesh, capture.points and capture.splats: geometry from files of other programs."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.base import File, Folder
from dextera_build.artifacts.geometry import Mesh
from dextera_build.artifacts.point_cloud import PointCloud
from dextera_build.errors import ArtifactError, RuleError
from dextera_build.testing import RuleRunner
from tests import factories

BOX = factories.box_asset().body.links["base"].mesh


def folder(*meshes: Mesh, scratch) -> Folder:
    for number, mesh in enumerate(meshes):
        mesh.save(scratch / "in" / f"mesh_{number}.obj")
    return Folder(files={path.name: path.read_bytes() for path in (scratch / "in").iterdir()})


@pytest.mark.parametrize("form", ["glb", "stl", "usdc"])
def test_a_mesh_is_read_from_one_file(tmp_path, form):
    plain = BOX.model_copy(update={"uv": None, "texture": None})
    file = File.of(plain.save(tmp_path / f"a.{form}")[0])
    found = RuleRunner(tmp_path).run("capture.mesh", options={"form": form}, file=file)
    assert np.array_equal(found.vertices[found.faces], BOX.vertices[BOX.faces])


def test_a_mesh_is_read_with_the_files_beside_it(tmp_path):
    found = RuleRunner(tmp_path).run("capture.mesh", file=folder(BOX, scratch=tmp_path))
    assert np.array_equal(found.texture.pixels, BOX.texture.pixels)


def test_unit_and_axis_can_be_told(tmp_path):
    file = File.of(BOX.save(tmp_path / "a.stl")[0])
    options = {"form": "stl", "unit_m": 0.001, "up": "y"}
    found = RuleRunner(tmp_path).run("capture.mesh", options=options, file=file)
    x, y, z = BOX.extent
    assert found.extent == pytest.approx(np.array([x, z, y]) / 1000)


def test_a_mesh_is_repaired(tmp_path):
    file = File.of(BOX.model_copy(update={"faces": BOX.faces[1:], "uv": BOX.uv[1:]}).save(tmp_path / "a.glb")[0])
    assert not RuleRunner(tmp_path).run("capture.mesh", file=file).is_closed
    assert RuleRunner(tmp_path).run("capture.mesh", options={"repair": True}, file=file).is_closed


def test_what_stays_open_is_refused(tmp_path):
    faces = np.concatenate([BOX.faces, [[0, 1, 7]]]).astype(np.int32)
    plain = BOX.model_copy(update={"faces": faces, "uv": None, "texture": None})
    file = File.of(plain.save(tmp_path / "a.ply")[0])
    options = {"form": "ply", "repair": True}
    with pytest.raises(RuleError, match="the mesh stays open after the repair"):
        RuleRunner(tmp_path).run("capture.mesh", options=options, file=file)


def test_a_folder_of_several_meshes_needs_a_name(tmp_path):
    two = folder(BOX, BOX, scratch=tmp_path)
    with pytest.raises(RuleError, match="the folder holds 2 meshes") as caught:
        RuleRunner(tmp_path).run("capture.mesh", file=two)
    assert caught.value.facts["meshes"] == "mesh_0.obj, mesh_1.obj"
    assert len(RuleRunner(tmp_path).run("capture.mesh", options={"path": "mesh_1.obj"}, file=two).faces) == 12
    with pytest.raises(RuleError, match=r"the folder does not hold `mesh_7\.obj`"):
        RuleRunner(tmp_path).run("capture.mesh", options={"path": "mesh_7.obj"}, file=two)


def test_points_are_read(tmp_path):
    cloud = PointCloud(points=np.eye(3, dtype=np.float32), frame="map")
    runner = RuleRunner(tmp_path)
    assert runner.run("capture.points", file=File(data=cloud.ply(text=True))).ply() == cloud.ply()
    assert runner.run("capture.points", options={"frame": "world"}, file=File(data=cloud.ply())).frame == "world"
    with pytest.raises(ArtifactError, match=r"`points\.ply` cannot be read as PLY"):
        runner.run("capture.points", file=File(data=b"points"))


@pytest.mark.parametrize("form", ["ply", "usda"])
def test_gaussians_are_read(tmp_path, form):
    made = factories.splats(4)
    file = File.of(made.save(tmp_path / f"a.{form}")[0])
    found = RuleRunner(tmp_path).run("capture.splats", options={"form": form}, file=file)
    assert np.allclose(found.scales, made.scales)
    assert found.frame == "object"

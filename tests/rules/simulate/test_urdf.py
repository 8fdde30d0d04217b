"""URDF folders: what MuJoCo compiles from them is the asset."""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.objects.object import Asset
from dextera_build.geometry import kinematics, metrics, transforms
from dextera_build.testing import RuleRunner
from tests import factories, object_views


@pytest.fixture
def runner(tmp_path):
    return RuleRunner(tmp_path)


def compiled(runner, asset: Asset, folder: Path) -> tuple[Folder, mujoco.MjModel]:
    written = runner.run("simulate.urdf", asset=asset)
    path = written.export(folder, "urdf")[0]
    assert path.name == "object.urdf"
    return written, mujoco.MjModel.from_xml_path(str(path))


def test_mass_and_inertia_come_through(runner, tmp_path):
    asset = factories.laptop_asset()
    _, model = compiled(runner, asset, tmp_path)
    expected = {name: link.mass_kg for name, link in asset.physics.links.items()}
    assert model.body_subtreemass[0] == pytest.approx(sum(expected.values()), rel=0.01)
    for name, link in asset.physics.links.items():
        assert model.body(name).mass[0] == pytest.approx(link.mass_kg, rel=1e-6)
        assert sorted(model.body(name).inertia) == pytest.approx(sorted(link.inertia[:3]), rel=1e-5)


def test_the_joint_has_its_axis_place_and_range(runner, tmp_path):
    asset = factories.laptop_asset()
    _, model = compiled(runner, asset, tmp_path)
    joint = model.joint("hinge")
    assert joint.axis == pytest.approx([-1.0, 0.0, 0.0])
    assert joint.range == pytest.approx([0.0, 2.3])
    assert model.body("lid").pos == pytest.approx([0.0, 0.11, 0.0165])
    assert joint.pos == pytest.approx([0.0, 0.0, 0.0])
    assert joint.damping[0] > 0.0
    assert joint.frictionloss[0] > 0.0


@pytest.mark.parametrize("position", [0.0, 1.9])
def test_the_links_stand_where_the_kinematics_of_the_asset_put_them(runner, tmp_path, position):
    asset = factories.laptop_asset()
    _, model = compiled(runner, asset, tmp_path)
    data = mujoco.MjData(model)
    data.joint("hinge").qpos = position
    mujoco.mj_forward(model, data)
    for name, pose in kinematics.link_poses(asset.body, {"hinge": position}).items():
        expected = transforms.apply(pose, asset.body.links[name].mesh.vertices.astype(np.float64))
        visuals = [
            g for g in range(model.ngeom) if model.geom_contype[g] == 0 and model.body(name).id == model.geom_bodyid[g]
        ]
        assert len(visuals) == 1
        found = geom_vertices(model, data, visuals[0])
        assert found.min(axis=0) == pytest.approx(expected.min(axis=0), abs=1e-5)
        assert found.max(axis=0) == pytest.approx(expected.max(axis=0), abs=1e-5)


def geom_vertices(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> np.ndarray:
    """World vertices of a mesh geom; the geom's frame takes MuJoCo's re-centring of meshes back."""
    mesh = model.geom_dataid[geom]
    start, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    return model.mesh_vert[start : start + count] @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]


@pytest.mark.medium
def test_a_photographed_laptop_comes_back_as_it_stood(runner, tmp_path):
    whole, _ = object_views.laptop(1.885)
    mesh, pose = object_views.mesh(whole), factories.pose(0.02, 0.01, 0.0, 0.3)
    seen = object_views.view(mesh, pose, category="laptop", body_type="articulated", material="electronics")
    shape = object_views.shape(mesh).model_copy(update={"pose": factories.placed(pose)})
    body = runner.run("factorize.articulate", shape=shape, **object_views.whole(seen))
    parts = {
        "physics": runner.run("factorize.physics", body=body, traits=seen.traits),
        "collision": runner.run("factorize.collision", body=body),
        "placement": runner.run("align.object", body=body, **object_views.sights(seen)),
    }
    asset = runner.run("simulate.asset", body=body, traits=seen.traits, **parts)
    _, model = compiled(runner, asset, tmp_path)
    data = mujoco.MjData(model)
    data.joint("hinge").qpos = asset.body.joints[0].position
    mujoco.mj_forward(model, data)
    visual = [geom for geom in range(model.ngeom) if model.geom_contype[geom] == 0]
    found = np.concatenate([geom_vertices(model, data, geom) for geom in visual])
    assert metrics.nearest(found, mesh.vertices.astype(np.float64)).max() < 3e-4
    assert metrics.nearest(mesh.vertices.astype(np.float64), found).max() < 3e-4
    assert asset.pose.matrix == pytest.approx(pose)
    assert model.body_subtreemass[0] == pytest.approx(1300.0 * whole.volume, rel=0.01)


def test_every_collision_piece_is_there(runner, tmp_path):
    asset = factories.bowl_asset()
    _, model = compiled(runner, asset, tmp_path)
    solid = [geom for geom in range(model.ngeom) if model.geom_contype[geom]]
    assert len(solid) == len(asset.collision.links["base"].hulls)


def test_a_ball_stays_in_the_bowl(runner, tmp_path):
    written, _ = compiled(runner, factories.bowl_asset(), tmp_path)
    assert len(written.files) > 17
    spec = mujoco.MjSpec.from_file(str(tmp_path / "object.urdf"))
    ball = spec.worldbody.add_body(pos=[0.003, 0.002, 0.15])
    ball.add_freejoint()
    ball.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.012, 0.0, 0.0], density=500.0)
    model = spec.compile()
    data = mujoco.MjData(model)
    while data.time < 2.0:
        mujoco.mj_step(model, data)
    assert data.qpos[2] == pytest.approx(0.005 + 0.012, abs=0.003)


def test_paths_are_relative_and_every_named_file_exists(runner):
    written = runner.run("simulate.urdf", asset=factories.box_asset())
    root = ElementTree.fromstring(written.files["object.urdf"])
    named = {node.get("filename") for node in root.iter() if node.get("filename")}
    assert named
    assert named <= set(written.files)
    material = written.files["meshes/base.mtl"].decode()
    assert "map_Kd base.png" in material
    assert b"mtllib base.mtl" in written.files["meshes/base.obj"]
    assert "meshes/base.png" in written.files


def test_what_urdf_demands_of_every_link_and_joint_is_there(runner):
    written = runner.run("simulate.urdf", asset=factories.laptop_asset(), options={"effort_nm": 7.0, "name": "laptop"})
    root = ElementTree.fromstring(written.files["object.urdf"])
    assert root.get("name") == "laptop"
    for link in root.iter("link"):
        assert link.find("inertial/mass") is not None
        assert link.find("visual") is not None
        assert link.find("collision") is not None
    (limit,) = root.iter("limit")
    assert {"lower", "upper", "effort", "velocity"} == set(limit.attrib)
    assert float(limit.get("effort")) == 7.0
    assert {node.get("rpy") for node in root.iter("origin")} == {"0 0 0"}


def test_a_robot_is_called_after_its_object(runner):
    written = runner.run("simulate.urdf", asset=factories.laptop_asset())
    assert ElementTree.fromstring(written.files["object.urdf"]).get("name") == "laptop"


def test_the_pose_in_the_world_stands_beside_it(runner):
    written = runner.run("simulate.urdf", asset=factories.laptop_asset(factories.pose(0.1, 0.2)))
    placement = json.loads(written.files["placement.json"])
    assert np.array(placement["world_from_object"]) == pytest.approx(factories.pose(0.1, 0.2))
    assert placement["joint_positions"] == {"hinge": 1.9}


def test_the_same_asset_gives_the_same_bytes(runner):
    one, two = (runner.run("simulate.urdf", asset=factories.bowl_asset()) for _ in range(2))
    assert runner.encode(one) == runner.encode(two)

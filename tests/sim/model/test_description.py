"""A twin described: the same files before and after the store, and robots put in."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.scenes.scene_description import Attachment, Box, SceneDescription
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import RuleError
from dextera_build.geometry import kinematics, transforms
from dextera_build.sim.model import attached, mjcf, model
from dextera_build.sim.usd import writer
from tests import factories, task_bundles, twins
from tests.artifacts.test_base import Memory

ASSETS = {
    "Box": factories.box_asset(factories.pose(-0.25, 0.1, 0.0, 0.3)),
    "laptop": factories.laptop_asset(factories.pose(0.1, 0.2, 0.0, -0.4)),
}
PLACE = factories.pose(0.4, -0.3, 0.0, yaw=0.8)


@pytest.fixture(scope="module")
def described() -> SceneDescription:
    return twins.described(ASSETS)


def robot(prefix: str, place: np.ndarray = PLACE) -> Attachment:
    pose = Pose(parent="world", child="base", matrix=place)
    return Attachment(prefix=prefix, robot=task_bundles.robot(), pose=pose)


def test_the_nodes_are_those_of_the_assets(described):
    assert described.bodies == ("box", "laptop")
    laptop = described.objects[1]
    assert [body.label for body in laptop.links.values()] == ["laptop", "laptop_lid"]
    assert described.exclude == (("laptop", "laptop_lid"),)
    masses = [link.mass_kg for asset in ASSETS.values() for link in asset.physics.links.values()]
    assert sum(body.inertia.mass_kg for thing in described.objects for body in thing.links.values()) == sum(masses)
    assert [geom.label for geom in described.static] == ["background", "static_support"]
    assert isinstance(described.static[1].shape, Box)


def test_surfaces_stand_where_kinematics_puts_them(described):
    asset, laptop = ASSETS["laptop"], described.objects[1]
    poses = kinematics.link_poses(asset.body)
    for part, pose in laptop.world_poses().items():
        wanted = transforms.apply(asset.pose.matrix @ poses[part], asset.body.links[part].mesh.vertices)
        assert transforms.apply(pose, laptop.links[part].geoms[0].vertices()) == pytest.approx(wanted, abs=1e-7)


def test_a_stored_scene_gives_the_same_files(described):
    memory = Memory()
    again = SceneDescription.decode(described.encode(memory.put), memory.__getitem__)
    assert mjcf.write(again) == mjcf.write(described)
    assert writer.write(again) == writer.write(described)


def test_robots_are_put_in_at_their_place(described):
    second = robot("second/", factories.pose(-0.6, 0.3, 0.0))
    made = described.model_copy(update={"attachments": (robot("robot/"), second)})
    loaded = model.compile_folder(attached.write(made))
    data = model.at_home(loaded)
    assert np.allclose(data.body("robot/base").xpos, PLACE[:3, 3])
    assert np.allclose(data.body("second/base").xpos, [-0.6, 0.3, 0.0])
    assert np.allclose(data.joint("laptop").qpos[:3], ASSETS["laptop"].pose.matrix[:3, 3], atol=1e-6)
    assert loaded.camera("capture").id == 0
    for prefix in ("robot/", "second/"):
        assert loaded.body_gravcomp[loaded.body(f"{prefix}palm").id] == 1
        for name, position in task_bundles.HOME_M.items():
            assert data.joint(f"{prefix}{name}").qpos[0] == position
            assert data.actuator(f"{prefix}{name}").ctrl[0] == position
    assert loaded.body_gravcomp[loaded.body("laptop").id] == 0


def test_what_a_format_cannot_hold_is_refused(described):
    made = described.model_copy(update={"attachments": (robot("robot/"),)})
    with pytest.raises(RuleError, match="which MJCF text alone cannot hold") as caught:
        mjcf.write(made)
    assert (caught.value.code, caught.value.facts) == ("DXB-B216", {"robots": "robot/"})


@pytest.mark.parametrize(("part", "what"), [("collision", "collision geometry"), ("physics", "mass")])
def test_a_link_that_cannot_be_touched_or_weighs_nothing_is_one_error(part, what):
    laptop = ASSETS["laptop"]
    whole = getattr(laptop, part)
    less = whole.model_copy(update={"links": {"base": whole.links["base"]}})
    with pytest.raises(RuleError, match=f"link `lid` of `laptop` has no {what}") as caught:
        twins.described({"laptop": laptop.model_copy(update={part: less})})
    assert caught.value.facts[what] == "base"


def test_a_scene_without_a_camera_is_written(described):
    bare = described.model_copy(update={"cameras": (), "lights": (), "objects": (), "exclude": (), "touch": ()})
    assert model.compile_folder(mjcf.write(bare)).ncam == 0
    assert b"Capture" not in writer.write(bare).files["scene.usda"]


def test_a_leaning_box_keeps_its_turn(described):
    lean = transforms.rigid(np.array([[1.0, 0, 0], [0, 0.8, -0.6], [0, 0.6, 0.8]]), np.array([0.0, 1.0, 0.5]))
    leaning = described.static[1].model_copy(
        update={"pose": Pose(parent="body", child="geom", matrix=lean), "label": "static_ramp"}
    )
    loaded = model.compile_folder(mjcf.write(described.model_copy(update={"static": (leaning,)})))
    assert np.allclose(model.at_home(loaded).geom("static_ramp").xmat.reshape(3, 3), lean[:3, :3])

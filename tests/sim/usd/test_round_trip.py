"""A scene with both robots written as USD, read back, and compared with MuJoCo's model of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdPhysics

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.scenes.scene_description import Attachment, Contact, SceneDescription
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import RuleError
from dextera_build.sim.model import attached, inventory, mjcf_contact
from dextera_build.sim.model.forward import Kinematics
from dextera_build.sim.model.model import at_home, compile_folder
from dextera_build.sim.usd import check, reader, writer
from tests import factories, task_bundles, twins
from tests.robots.robot_recipes import built
from tests.robots.robot_recipes import described as described_robot

PLACES = {"kuka_leap": (-0.6, -0.3, 0.8), "openarm_revo1": (0.9, 0.4, -2.0)}


@pytest.fixture(scope="module")
def robots(tmp_path_factory: pytest.TempPathFactory) -> dict[str, RobotModel]:
    return {name: built(name, tmp_path_factory.mktemp(name)) for name in PLACES}


@pytest.fixture(scope="module")
def described(robots: dict[str, RobotModel]) -> SceneDescription:
    assets = {
        "Box": factories.box_asset(factories.pose(-0.25, 0.1, 0.0, 0.3)),
        "bowl": factories.bowl_asset(factories.pose(0.3, -0.2)),
        "laptop": factories.laptop_asset(factories.pose(0.1, 0.2, 0.0, -0.4), opening=1.9),
    }
    made = twins.described(assets)
    return made.model_copy(update={"attachments": tuple(_attached(name, robots[name]) for name in PLACES)})


def _attached(name: str, robot: RobotModel) -> Attachment:
    x, y, yaw = PLACES[name]
    pose = Pose(parent="world", child="base", matrix=factories.pose(x, y, 0.0, yaw=yaw))
    return Attachment(prefix=f"{name}/", robot=robot, pose=pose)


@pytest.fixture(scope="module")
def folder(described: SceneDescription) -> Folder:
    return writer.write(described)


@pytest.fixture(scope="module")
def wanted(described: SceneDescription) -> inventory.Inventory:
    return inventory.of_model(compile_folder(attached.write(described)))


@pytest.fixture
def stage(folder: Folder, tmp_path: Path) -> Any:
    return check.opened(folder, tmp_path)


def joints(stage: Any, robot: str) -> dict[str, Any]:
    """Joint of a robot, without its prefix -> prim."""
    prims = stage.GetPrimAtPath(f"/World/{robot}/joints").GetChildren()
    return {prim.GetDisplayName().removeprefix(f"{robot}/"): prim for prim in prims if prim.GetDisplayName()}


@pytest.mark.medium
def test_stage_and_mjcf_are_the_same_scene(stage: Any, wanted: inventory.Inventory) -> None:
    found = reader.inventory(stage)
    assert inventory.differences(wanted, found) == []
    assert len(found.bodies) == 1 + 4 + 25 + 39
    assert sum(joint.stiffness > 0 for joint in found.joints.values()) == 23 + 26
    assert sum(bool(joint.follows[0]) for joint in found.joints.values()) == 8
    assert sum(len(body.colliders) for body in found.bodies.values()) > 150


def test_every_validator_is_content(folder: Folder, tmp_path: Path) -> None:
    assert check.problems(folder, tmp_path) == []


HINGE, DRIVE = "/World/laptop/Joints/hinge", "/World/robot/joints/left"
CHANGES = [
    ("/World/box/base", "physics:mass", 1.001),
    ("/World/box/base", "physics:diagonalInertia", 1.001),
    ("/World/laptop/lid", "physics:centerOfMass", 1.01),
    ("/World/box/Looks/contact", "physics:dynamicFriction", 1.01),
    ("/World/box/Looks/contact", "physics:restitution", 2.0),
    (HINGE, "physxJointAxis:angular:staticFrictionEffort", 1.01),
    (HINGE, "physics:upperLimit", 1.001),
    (HINGE, "drive:angular:physics:damping", 1.01),
    (HINGE, "physics:localPos0", 1.01),
    (HINGE, "physics:localPos1", Gf.Vec3f(0.0, 0.0, 1e-4)),
    ("/World/laptop/lid", "xformOp:translate", 1.001),
    ("/World/robot", "xformOp:translate", 1.001),
    (DRIVE, "drive:linear:physics:stiffness", 1.001),
    (DRIVE, "drive:linear:physics:maxForce", 1.001),
    (DRIVE, "drive:linear:physics:targetPosition", 1.001),
]


@pytest.fixture(scope="module")
def small() -> SceneDescription:
    assets = {
        "box": factories.box_asset(factories.pose(-0.25, 0.1, 0.0, 0.3)),
        "laptop": factories.laptop_asset(factories.pose(0.1, 0.2, 0.0, -0.4), opening=1.9),
    }
    made = twins.described(assets)
    base = Pose(parent="world", child="base", matrix=factories.pose(0.4, -0.3, 0.0, yaw=0.8))
    here = Attachment(prefix="robot/", robot=task_bundles.robot(), pose=base)
    return made.model_copy(update={"attachments": (here,)})


def test_every_changed_number_is_found(small: SceneDescription, tmp_path: Path) -> None:
    stage = check.opened(writer.write(small), tmp_path)
    wanted = inventory.of_model(compile_folder(attached.write(small)))
    assert inventory.differences(wanted, reader.inventory(stage)) == []
    for path, name, change in CHANGES:
        attribute = stage.GetPrimAtPath(path).GetAttribute(name)
        before = attribute.Get()
        assert attribute.Set(before * change if isinstance(change, float) else change)
        assert inventory.differences(wanted, reader.inventory(stage)), (path, name)
        attribute.Set(before)
    assert inventory.differences(wanted, reader.inventory(stage)) == []


def test_a_changed_robot_is_found(stage: Any, wanted: inventory.Inventory) -> None:
    revo = joints(stage, "openarm_revo1").values()
    follower = next(prim for prim in revo if prim.GetRelationship("physxMimicJoint:rotX:referenceJoint"))
    gearing = follower.GetAttribute("physxMimicJoint:rotX:gearing")
    gearing.Set(gearing.Get() * 1.001)
    finger = next(prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Capsule))
    UsdGeom.Capsule(finger).GetRadiusAttr().Set(0.001)
    filtered = next(prim for prim in stage.Traverse() if prim.HasAPI(UsdPhysics.FilteredPairsAPI))
    UsdPhysics.FilteredPairsAPI(filtered).GetFilteredPairsRel().ClearTargets(True)
    found = inventory.differences(wanted, reader.inventory(stage))
    assert len(found) == 3
    assert [any(word in line for line in found) for word in ("follows", "radius", "apart")] == [True] * 3


def test_drives_are_in_degrees(stage: Any, robots: dict[str, RobotModel]) -> None:
    for name, robot in robots.items():
        prims = joints(stage, name)
        assert list(prims)
        assert {joint.name for joint in robot.joints} <= prims.keys()
        for joint in robot.joints:
            revolute, drive = (
                UsdPhysics.RevoluteJoint(prims[joint.name]),
                UsdPhysics.DriveAPI(prims[joint.name], "angular"),
            )
            limits = (revolute.GetLowerLimitAttr().Get(), revolute.GetUpperLimitAttr().Get())
            assert np.radians(limits) == pytest.approx((joint.lower, joint.upper), abs=1e-5)
            assert np.radians(drive.GetTargetPositionAttr().Get()) == pytest.approx(joint.home, abs=1e-6)
            assert drive.GetMaxForceAttr().Get() == pytest.approx(joint.effort)
            fastest = prims[joint.name].GetAttribute("physxJoint:maxJointVelocity").Get()
            assert np.radians(fastest) == pytest.approx(joint.velocity, rel=1e-6)
    options = described_robot("kuka_leap")["chains"][0]["links"]
    first = next(link["joint"] for link in options if link.get("joint"))
    stiffness = UsdPhysics.DriveAPI(joints(stage, "kuka_leap")[first["name"]], "angular").GetStiffnessAttr().Get()
    assert stiffness == pytest.approx(first["stiffness_nm_rad"] * np.pi / 180)


def test_a_robot_is_one_articulation_as_isaac_lab_looks_for_it(stage: Any) -> None:
    for name in PLACES:
        below = list(Usd.PrimRange(stage.GetPrimAtPath(f"/World/{name}")))
        roots = [prim for prim in below if prim.HasAPI(UsdPhysics.ArticulationRootAPI)]
        assert [str(prim.GetPath()) for prim in roots] == [f"/World/{name}"]
        links = [prim for prim in below if prim.HasAPI(UsdPhysics.RigidBodyAPI)]
        assert all(prim.GetParent() == roots[0] for prim in links), "rigid bodies are siblings"
        assert all(prim.GetAttribute("physxRigidBody:disableGravity").Get() for prim in links)
        anchors = [UsdPhysics.FixedJoint(prim) for prim in below if prim.GetName() == "root"]
        assert [str(joint.GetBody1Rel().GetTargets()[0]) for joint in anchors] == [f"/World/{name}/base"]
        assert roots[0].GetAttribute("semantics:labels:class").Get() == ["robot"]
    assert stage.GetPrimAtPath("/World/laptop").GetAttribute("semantics:labels:class").Get() == ["laptop"]
    tip = UsdGeom.Xformable(stage.GetPrimAtPath("/World/kuka_leap/if_ds/Frames/tip_index"))
    assert isinstance(tip.ComputeLocalToWorldTransform(0).ExtractTranslation(), Gf.Vec3d)


def test_a_fingertip_grips_better_than_the_table(small: SceneDescription, robots: dict[str, RobotModel]) -> None:
    """MuJoCo's own contacts: the larger friction at a skin, the object's own on the table and on any other link."""
    tip = Kinematics(robots["kuka_leap"])
    tip.pose({})
    base = np.eye(4)
    base[:3, 3] = factories.pose(-0.25, 0.1)[:3, 3] + [0, 0, 0.02] - tip.frame("tip_index")[:3, 3]
    here = Attachment(prefix="robot/", robot=robots["kuka_leap"], pose=Pose(parent="world", child="base", matrix=base))
    model = compile_folder(attached.write(small.model_copy(update={"attachments": (here,)})))
    data = at_home(model)
    data.joint("box").qpos[2] -= 0.001
    mujoco.mj_forward(model, data)
    pairs: dict[str, set[float]] = {"table": set(), "skin": set(), "link": set()}
    for contact in data.contact:
        bodies = [model.body(model.geom_bodyid[geom]).name for geom in contact.geom]
        if "box" in bodies:
            other = int(contact.geom[1 - bodies.index("box")])
            skin = "skin" if model.geom_friction[other, 0] == 0.8 else "link"
            pairs["table" if "world" in bodies else skin].add(round(float(contact.friction[0]), 6))
    assert pairs == {"table": {0.5}, "skin": {0.8}, "link": {0.5}}
    stage = Usd.Stage.CreateInMemory()
    stage.GetRootLayer().ImportFromString(writer.write(small).files["scene.usda"].decode())
    box = reader.inventory(stage).bodies["box"].colliders[0]
    assert box.friction == pytest.approx(0.5)


def test_a_soft_thing_has_a_spring(small: SceneDescription) -> None:
    contact = Contact(friction=0.5, restitution=0.3, stiffness_n_m=2000.0)
    soft = small.objects[0]
    body = soft.links[soft.root]
    geoms = tuple(geom if geom.contact is None else geom.model_copy(update={"contact": contact}) for geom in body.geoms)
    links = {soft.root: body.model_copy(update={"geoms": geoms})}
    made = small.model_copy(update={"objects": (soft.model_copy(update={"links": links}),), "touch": (), "exclude": ()})
    stage = Usd.Stage.CreateInMemory()
    stage.GetRootLayer().ImportFromString(writer.write(made).files["scene.usda"].decode())
    material = stage.GetPrimAtPath("/World/box/Looks/contact")
    assert material.GetAttribute("physxMaterial:compliantContactStiffness").Get() == pytest.approx(2000.0)
    damping = material.GetAttribute("physxMaterial:compliantContactDamping").Get()
    ratio = damping / 2 / np.sqrt(2000.0 * soft.mass_kg)
    assert mjcf_contact.bounce(ratio) == pytest.approx(0.3, abs=1e-3)
    assert material.GetAttribute("physxMaterial:frictionCombineMode").Get() == "max"


def test_a_robot_and_an_object_of_one_name_are_refused(described: SceneDescription) -> None:
    here = described.attachments[0].model_copy(update={"prefix": "laptop/"})
    with pytest.raises(RuleError, match="a robot and something else are called `laptop/`"):
        writer.write(described.model_copy(update={"attachments": (here,)}))

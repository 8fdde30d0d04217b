"""The written USD: valid, complete, and the same twin as the MJCF."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdPhysics, UsdShade

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.objects.object import Asset
from dextera_build.geometry import cameras, kinematics, quaternions, transforms
from dextera_build.sim.usd import check as usd_check
from dextera_build.sim.usd import writer as usd
from tests import factories, twins

LENS = factories.camera(640, 480)


@pytest.fixture(scope="module")
def assets() -> dict[str, Asset]:
    return {
        "Box": factories.box_asset(factories.pose(-0.25, 0.1, 0.0, 0.3)),
        "bowl": factories.bowl_asset(factories.pose(0.3, -0.2)),
        "laptop": factories.laptop_asset(factories.pose(0.1, 0.2, 0.0, -0.4), opening=1.9),
    }


@pytest.fixture(scope="module")
def folder(assets: dict[str, Asset]) -> Folder:
    return usd.write(twins.described(assets, lens=LENS))


@pytest.fixture(scope="module")
def stage(folder: Folder, tmp_path_factory: pytest.TempPathFactory) -> Any:
    place = tmp_path_factory.mktemp("usd")
    folder.export(place, "scene")
    return Usd.Stage.Open(str(place / "scene.usda"))


def world(stage: Any, path: str) -> np.ndarray:
    """Row vectors in USD, column vectors here."""
    return np.array(UsdGeom.Xformable(stage.GetPrimAtPath(path)).ComputeLocalToWorldTransform(0)).T


def test_every_validator_is_content(folder: Folder, tmp_path: Path) -> None:
    assert usd_check.problems(folder, tmp_path) == []


@pytest.mark.parametrize(
    ("old", "new", "validator"),
    [
        ("</World/laptop/lid>", "</World/laptop/no_such>", "Joint"),
        ("textures/box.png", "textures/none.png", "Unresolvable"),
        ('upAxis = "Z"', "", "Axis"),
    ],
)
def test_the_validators_do_find_faults(folder: Folder, tmp_path: Path, old: str, new: str, validator: str) -> None:
    text = folder.files["scene.usda"].decode()
    assert old in text
    broken = Folder(files={**folder.files, "scene.usda": text.replace(old, new).encode()})
    assert any(validator in problem for problem in usd_check.problems(broken, tmp_path))


def test_stage_metadata(stage: Any) -> None:
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert UsdPhysics.GetStageKilogramsPerUnit(stage) == 1.0
    assert str(stage.GetDefaultPrim().GetPath()) == "/World"


def test_bodies_masses_and_inertia_round_trip(stage: Any, assets: dict[str, Asset]) -> None:
    bodies = [prim for prim in stage.Traverse() if prim.HasAPI(UsdPhysics.RigidBodyAPI)]
    names = ["/World/bowl/base", "/World/box/base", "/World/laptop/base", "/World/laptop/lid"]
    assert sorted(str(prim.GetPath()) for prim in bodies) == names
    wanted = assets["laptop"].physics.links["lid"]
    mass = UsdPhysics.MassAPI(stage.GetPrimAtPath("/World/laptop/lid"))
    assert mass.GetMassAttr().Get() == pytest.approx(wanted.mass_kg)
    assert sorted(mass.GetDiagonalInertiaAttr().Get()) == pytest.approx(sorted(wanted.inertia[:3]), rel=1e-5)
    centre = np.array(mass.GetCenterOfMassAttr().Get()) + assets["laptop"].body.joints[0].origin
    np.testing.assert_allclose(centre, wanted.centre, atol=1e-7)


def test_colliders_are_hidden_convex_hulls_with_their_friction(stage: Any) -> None:
    colliders = [prim for prim in stage.Traverse() if prim.HasAPI(UsdPhysics.CollisionAPI)]
    assert len(colliders) == 1 + 1 + 17 + 2
    for prim in colliders:
        assert UsdPhysics.MeshCollisionAPI(prim).GetApproximationAttr().Get() == "convexHull"
        assert UsdGeom.Imageable(prim).GetPurposeAttr().Get() == "guide"
    piece = stage.GetPrimAtPath("/World/box/base/Collision/piece_0")
    material, _ = UsdShade.MaterialBindingAPI(piece).ComputeBoundMaterial("physics")
    assert UsdPhysics.MaterialAPI(material.GetPrim()).GetDynamicFrictionAttr().Get() == pytest.approx(0.5)


def test_joint_limits_frames_and_the_observed_angle(stage: Any, assets: dict[str, Asset]) -> None:
    joint = UsdPhysics.RevoluteJoint(stage.GetPrimAtPath("/World/laptop/Joints/hinge"))
    assert joint.GetLowerLimitAttr().Get() == pytest.approx(0.0)
    assert np.radians(joint.GetUpperLimitAttr().Get()) == pytest.approx(2.3, abs=1e-5)
    frames = []
    for side, link in (("0", "base"), ("1", "lid")):
        prim = joint.GetPrim()
        place = np.array(prim.GetAttribute(f"physics:localPos{side}").Get())
        turn = prim.GetAttribute(f"physics:localRot{side}").Get()
        local = transforms.rigid(quaternions.to_matrix(np.array([turn.real, *turn.imaginary])), place)
        frames.append(world(stage, f"/World/laptop/{link}") @ local)
    between = transforms.invert(frames[0]) @ frames[1]
    np.testing.assert_allclose(between[:3, 3], 0.0, atol=1e-6)
    angle = 1.9
    np.testing.assert_allclose(between[1:3, 1], [np.cos(angle), np.sin(angle)], atol=1e-5)
    np.testing.assert_allclose(frames[0][:3, 0], assets["laptop"].pose.matrix[:3, 0] * -1.0, atol=1e-6)
    assert stage.GetPrimAtPath("/World/laptop/base").HasAPI(UsdPhysics.ArticulationRootAPI)


def test_visuals_stand_where_the_twin_says(stage: Any, assets: dict[str, Asset]) -> None:
    laptop = assets["laptop"]
    pose = laptop.pose.matrix @ kinematics.link_poses(laptop.body)["lid"]
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/World/laptop/lid/Visual"))
    points = transforms.apply(world(stage, "/World/laptop/lid/Visual"), np.array(mesh.GetPointsAttr().Get()))
    np.testing.assert_allclose(points, transforms.apply(pose, laptop.body.links["lid"].mesh.vertices), atol=1e-6)


def test_no_rigid_body_is_scaled(stage: Any) -> None:
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.Xform):
            np.testing.assert_allclose(np.linalg.norm(world(stage, str(prim.GetPath()))[:3, :3], axis=0), 1.0)


def test_the_camera_projects_as_the_intrinsics_say(stage: Any) -> None:
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/World/Capture")).GetCamera(0)
    frustum = camera.frustum
    view, projection = np.array(frustum.ComputeViewMatrix()), np.array(frustum.ComputeProjectionMatrix())
    points = np.array([[0.0, 0.0, 0.0], [0.3, 0.2, 0.1], [-0.2, -0.1, 0.3]])
    clip = np.concatenate([points, np.ones((3, 1))], axis=1) @ view @ projection
    ndc = clip[:, :2] / clip[:, 3:]
    found = np.stack([(ndc[:, 0] + 1) / 2 * LENS.width - 0.5, (1 - ndc[:, 1]) / 2 * LENS.height - 0.5], axis=1)
    back = transforms.invert(factories.support().camera_pose.matrix)
    np.testing.assert_allclose(found, cameras.project(transforms.apply(back, points), LENS.matrix()), atol=1e-2)


def test_bytes_are_stable_and_paths_relative(assets: dict[str, Asset], folder: Folder) -> None:
    again = usd.write(twins.described(dict(reversed(assets.items())), lens=LENS))
    assert again.files == folder.files
    assert "@/" not in folder.files["scene.usda"].decode()
    assert "@./textures/box.png@" in folder.files["scene.usda"].decode()

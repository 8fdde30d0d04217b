"""Pictures, depth, several cameras and joint states are those of one time, or the run is stopped."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="needs rosbags (extra `ros`)")

from dextera_build.deploying.checkup import checkup
from dextera_build.deploying.faults import Fault
from dextera_build.deploying.simulated import Simulation
from dextera_build.deploying.transport import Topic
from dextera_build.formats.ros import hashes, images, messages
from dextera_build.policy.observation import Frame, Frames
from dextera_build.sim.runtime.environment import Environment
from tests import factories
from tests.deploying.robots import Line, Rig

FAR = np.array([0.3, -0.2, 0.05, 0.04, 0.04])
EXACT = Simulation(loss=0.0)


def look(world: Environment) -> Frames:
    """Colours and depth that say how far slide x is."""
    place = world.measure().joints[0]
    rgb = np.full((24, 32, 3), round(100 + 300 * place), np.uint8)
    return {"workspace": Frame(rgb, np.full((24, 32), 0.5 + place, np.float32))}


def seeing(*needed: str, simulation: Simulation = EXACT) -> Rig:
    return Rig(look=look, lenses={"workspace": factories.camera(32, 24)}, needed=needed, simulation=simulation)


def behind(rig: Rig, seconds: float) -> None:
    """Set the clock of the camera back."""
    see = rig.robot._see
    rig.robot._see = lambda stamp: see(stamp - round(seconds * 1e9))  # type: ignore[method-assign]


def held_back(rig: Rig, changed: Callable[[Topic, bytes], tuple[int, bytes]]) -> None:
    """Publish what the robot publishes when, and as, a function says [ns]."""
    publish, tick, waiting = rig.robot._transport.publish, rig.robot.tick, deque[tuple[int, Topic, bytes]]()

    def later(topic: Topic, message: bytes) -> None:
        at, told = changed(topic, message)
        waiting.append((at, topic, told)) if at > rig.time else publish(topic, told)

    def ticks() -> None:
        while waiting and waiting[0][0] <= rig.time:
            publish(*waiting.popleft()[1:])
        tick()

    rig.robot._transport.publish = later  # type: ignore[method-assign]
    rig.robot.tick = ticks  # type: ignore[method-assign]


@pytest.mark.parametrize(("depth_s", "loss"), [(0.0, 0.0), (0.02, 0.0), (0.05, 0.02)])
def test_a_picture_comes_with_its_own_depth_which_arrives_later(depth_s: float, loss: float) -> None:
    rig = seeing("rgb", "depth", simulation=Simulation(loss=loss, depth_s=depth_s))
    policy = Line(FAR)
    ran = rig.drive(policy, limit_s=5.0)
    assert (ran.faulty, ran.steps) == (False, 100), ran.reason
    frames = [each.frames["workspace"] for each in policy.seen]
    colours = np.array([np.asarray(each.rgb).mean() for each in frames])
    depths = np.array([np.asarray(each.depth).mean() for each in frames])
    assert np.ptp(depths) > 0.25
    assert depths == pytest.approx(0.5 + (colours - 100) / 300, abs=0.006)  # JPEG
    assert depths == pytest.approx([0.5 + each["joints"][0] for each in policy.seen], abs=0.006)


def test_depth_that_belongs_to_no_picture_is_told() -> None:
    rig = seeing("rgb", "depth")

    def changed(topic: Topic, message: bytes) -> tuple[int, bytes]:
        if topic.kind != "sensor_msgs/Image":
            return rig.time, message
        read = hashes.read(topic.kind, message)
        counts = np.round(1000 * images.depths(read, topic.name)).astype(np.uint16)
        stamp = read.header.stamp.sec * 10**9 + read.header.stamp.nanosec
        return rig.time, messages.depth_image(stamp - 30_000_000, "workspace", counts)

    held_back(rig, changed)
    ran = rig.drive(Line(FAR))
    both = "/workspace/color/image_raw/compressed with /workspace/aligned_depth_to_color/image_raw of the same time"
    assert ran.reason == f"the guard stopped the robot: nothing arrived on {both} in 10 s"


@pytest.mark.parametrize("phase_s", [0.03, 0.055])
def test_cameras_that_run_freely_are_matched(phase_s: float) -> None:
    def two(world: Environment) -> Frames:
        (frame,) = look(world).values()
        return {"front": replace(frame, depth=None), "side": replace(frame, depth=None)}

    lens = factories.camera(32, 24)
    rig = Rig(look=two, lenses={"front": lens, "side": lens}, needed=("rgb",), simulation=EXACT)

    def changed(topic: Topic, message: bytes) -> tuple[int, bytes]:
        if not topic.name.startswith("/side/"):
            return rig.time, message
        at = rig.time + round(phase_s * 1e9)
        return at, messages.compressed_image(at, "side", "jpeg", bytes(hashes.read(topic.kind, message).data))

    held_back(rig, changed)
    ran = rig.drive(Line(FAR), limit_s=4.0)
    assert (ran.faulty, ran.steps) == (False, 80), ran.reason


@pytest.mark.parametrize(("clock_s", "how"), [(-0.5, "0.50 s later"), (-1.5, "1.50 s later"), (0.3, "0.30 s earlier")])
def test_a_camera_with_another_clock_is_found_and_moves_nothing(clock_s: float, how: str) -> None:
    rig = seeing("rgb")
    behind(rig, -clock_s)
    checks = checkup(rig.transport, rig.cell._topics, rig.cell, rig.bundle.robot, rig.sleep, 1.0)
    (failed,) = [each for each in checks if not each.ok]
    assert failed.what == "/workspace/color/image_raw/compressed clock"
    assert how in failed.found
    ran = rig.drive(Line(FAR))
    assert f"comes {how} than /joint_states with the same stamps" in ran.reason
    assert rig.robot.heard.commands == 0


@pytest.mark.parametrize("slow_s", [0.1, 0.19])
def test_a_camera_that_takes_its_time_is_none_with_another_clock(slow_s: float) -> None:
    rig = seeing("rgb")
    behind(rig, slow_s)
    assert not rig.drive(Line(FAR)).faulty


@pytest.mark.parametrize("needed", ["rgb", "depth", "cloud"])
def test_a_camera_that_is_frozen_stops_each_policy_that_takes_it(needed: str) -> None:
    simulation = Simulation(loss=0.0, faults=(Fault("pictures_freeze", at_s=0.5),))
    ran = seeing(needed, simulation=simulation).drive(Line(FAR), limit_s=4.0)
    assert ran.reason == "the guard stopped the robot: `workspace` shows the same picture while the robot moves"

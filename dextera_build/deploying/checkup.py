"""What must be right before a robot moves: topics, types, qualities, rates, clock, joints; each with what mends it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.deploying.cell import RosCell, Sleep
from dextera_build.deploying.stream import Stream
from dextera_build.deploying.topics import Topics
from dextera_build.deploying.transport import Endpoint, Topic, Transport
from dextera_build.formats.ros import hashes

LEAST_STATES = 2.5
"""Fewest joint states per control period, so that a lost one is no silence."""
CLOCK_S = 0.05
"""Offset of clocks that is reported [s]; a run corrects it, recordings of both machines do not."""
NEAR_RAD = 0.05
"""Distance from home at which signs can be compared [rad or m]."""
OUTSIDE_RAD = 0.02
"""Distance beyond a limit that is an error of calibration, not of a name or sign [rad or m]."""


@dataclass(frozen=True)
class Check:
    """One check."""

    what: str
    """What was checked."""
    ok: bool
    """Whether it is right."""
    found: str
    """What was found."""
    mend: str = ""
    """What to do."""


def checkup(
    transport: Transport, topics: Topics, cell: RosCell, robot: RobotModel, sleep: Sleep, listen_s: float = 3.0
) -> tuple[Check, ...]:
    """Listen to a robot, and compare what it publishes with what a run needs. Nothing is sent.

    Args:
        transport: Connected to the robot.
        topics: Its topics.
        cell: Reads them.
        robot: The model.
        sleep: Waits [s].
        listen_s: Time to listen [s].
    """
    sleep(listen_s)
    others = transport.others()
    needed = {stream.topic for stream in cell.needed_streams()}
    found = [check for topic in topics.measured() if topic.name in needed for check in _published(topic, others)]
    found += [check for controller in topics.controllers for check in _read(controller.topic, others)]
    found += [check for stream in cell.needed_streams() for check in _arrives(stream)]
    found += _clock(cell.state, LEAST_STATES * cell.rate_hz)
    found += _joints(cell, robot)
    return tuple(found)


def _published(topic: Topic, others: tuple[Endpoint, ...]) -> Iterator[Check]:
    """Whether somebody publishes a topic as it is read here."""
    writers = [each for each in others if each.topic == topic.name and each.writes]
    if not writers:
        known = sorted({each.topic for each in others if each.writes and each.kind == topic.kind})
        yield Check(
            f"{topic.name} is published",
            False,
            f"nobody publishes it; of this type: {', '.join(known) or 'none'}",
            f"name it in the robot's `simulate.ros_names`: `{known[0]}`" if known else "start the driver of the robot",
        )
        return
    yield Check(f"{topic.name} is published", True, f"{len(writers)} writer")
    yield from _fits(topic, writers[0])
    yield Check(
        f"{topic.name} quality",
        writers[0].quality.admits(topic.quality),
        f"offered {writers[0].quality}, requested {topic.quality}",
        f"let the driver publish `{topic.name}` as {topic.quality}",
    )


def _read(topic: Topic, others: tuple[Endpoint, ...]) -> Iterator[Check]:
    """Whether a controller reads a topic of commands as it is published here."""
    readers = [each for each in others if each.topic == topic.name and not each.writes]
    if not readers:
        known = sorted({each.topic for each in others if not each.writes and each.kind == topic.kind})
        mend = (
            f"name it in `controllers`: `{known[0]}`" if known else "`ros2 control switch_controllers --activate NAME`"
        )
        yield Check(f"{topic.name} has a controller", False, f"nobody reads it; of this type: {known or 'none'}", mend)
        return
    yield Check(f"{topic.name} has a controller", True, f"{len(readers)} reader")
    yield from _fits(topic, readers[0])
    yield Check(
        f"{topic.name} quality",
        topic.quality.admits(readers[0].quality),
        f"offered {topic.quality}, requested {readers[0].quality}",
        f"let the controller read `{topic.name}` as {topic.quality}",
    )


def _fits(topic: Topic, other: Endpoint) -> Iterator[Check]:
    """Whether type and type hash agree."""
    yield Check(
        f"{topic.name} type", other.kind == topic.kind, other.kind, f"`{topic.kind}` is needed; name another topic"
    )
    own = hashes.type_hash(topic.kind)
    if other.kind == topic.kind:
        told = other.type_hash or "not stated (ROS 2 before Iron)"
        mend = "the robot's definition of the message differs: install the ROS 2 packages of its distribution"
        yield Check(f"{topic.name} type hash", other.type_hash in ("", own), told, mend)


def _arrives(stream: Stream) -> Iterator[Check]:
    """Whether usable messages arrive, and fast enough."""
    if stream.fault:
        mend = "correct `joints` of the robot's `simulate.ros_names`" if "lacks" in stream.fault else "see the driver"
        yield Check(f"{stream.name} arrives", False, stream.fault, mend)
    elif stream.last is None:
        yield Check(
            f"{stream.name} arrives",
            False,
            "no message",
            "allow UDP ports 7400 to 7500 in both firewalls; compare ROS_DOMAIN_ID and `--domain`",
        )
    else:
        yield Check(f"{stream.name} arrives", True, f"{stream.count} messages, {stream.rate_hz():.1f} Hz")


def _clock(state: Stream, least_hz: float) -> Iterator[Check]:
    """Rate of joint states, and the offset of the robot's clock, which is only reported."""
    if state.last is None:
        return
    rate = state.rate_hz()
    yield Check(
        "rate of joint states",
        rate >= least_hz,
        f"{rate:.1f} Hz",
        f"raise `update_rate` of the controller manager to {least_hz:g} Hz or more",
    )
    offset = state.offset_s
    remark = "; `chrony` on both machines would set it" if abs(offset) > CLOCK_S else ""
    yield Check("clock", True, f"{1000 * offset:.1f} ms behind this machine's with the delay, corrected{remark}")


def _joints(cell: RosCell, robot: RobotModel) -> Iterator[Check]:
    """Whether the positions can be those of the model: within limits, and not mirrored at home."""
    if cell.state.last is None:
        return
    places = np.asarray(cell.state.last.value)
    for joint, place in zip(robot.joints, places, strict=True):
        if not joint.lower - OUTSIDE_RAD <= place <= joint.upper + OUTSIDE_RAD:
            yield Check(
                f"joint {joint.name}",
                False,
                f"{place:.3f} is not within {joint.lower:.3f} to {joint.upper:.3f}",
                f"`flipped: [{joint.name}]` if it has the other sign, or correct its zero",
            )
    homes = np.array([joint.home for joint in robot.joints])
    mirrored = (np.abs(places + homes) < NEAR_RAD) & (np.abs(homes) > 2 * NEAR_RAD)
    names = [joint.name for joint, wrong in zip(robot.joints, mirrored, strict=True) if wrong]
    if names:
        yield Check(
            "signs",
            False,
            f"{', '.join(names)}: home with the other sign",
            f"`flipped: [{', '.join(names)}]` in the robot's `simulate.ros_names`",
        )
    else:
        at_home = int((np.abs(places - homes) < NEAR_RAD).sum())
        yield Check("signs", True, f"{at_home} of {len(homes)} joints are at home; others are not compared")

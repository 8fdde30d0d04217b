"""What must be right before a robot moves: topics, types, qualities, rates, clock, joints; each with what mends it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.deploying.cell import RosCell, Sleep
from dextera_build.deploying.stream import Stream
from dextera_build.deploying.topics import Topics
from dextera_build.deploying.transport import Endpoint, Quality, Topic, Transport
from dextera_build.errors import listing
from dextera_build.formats.ros import hashes

LEAST_STATES = 2.5
"""Fewest joint states per control period, so that a lost one is no silence."""
CLOCK_S = 0.05
"""Offset of clocks that is reported [s]; a run corrects it, recordings of both machines do not."""
NEAR_RAD = 0.05
"""Distance from home at which signs can be compared [rad or m]."""
OUTSIDE_RAD = 0.02
"""Distance beyond a limit that is an error of calibration, not of a name or sign [rad or m]."""


UNHEARD = "allow UDP ports 7400 to 7500 in both firewalls; compare ROS_DOMAIN_ID and `--domain`"
"""What mends a silent topic."""
UNNAMED = (
    "correct `joints` of the robot's `simulate.ros_names`; if another driver publishes the missing ones, start it, or"
    " add its topic to `joint_states`"
)
"""What mends joint states that lack a joint."""
UNSEEN = "is `{}` in the picture, and is a tracker running? `--cell` starts one, which says what it does not find"
"""What mends an object without a pose."""


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
    transport: Transport,
    topics: Topics,
    cell: RosCell,
    robot: RobotModel,
    sleep: Sleep,
    listen_s: float = 3.0,
    *,
    commands: bool = True,
) -> tuple[Check, ...]:
    """Listen to a robot, and compare what it publishes with what a run needs. Nothing is sent.

    Args:
        transport: Connected to the robot.
        topics: Its topics.
        cell: Reads them.
        robot: The model.
        sleep: Waits [s].
        listen_s: Time to listen [s].
        commands: Whether dxb is the one who commands the robot, so that nobody else may.
    """
    sleep(listen_s)
    others, fits = transport.others(), transport.fits
    needed = {stream.topic for stream in cell.needed_streams()} | {each.name for each in topics.more_joints}
    heard = {stream.topic for stream in cell.needed_streams() if stream.last is not None}
    found = [
        check
        for topic in topics.measured()
        if topic.name in needed
        for check in _matched(topic, others, fits, DRIVER, arrives=topic.name in heard)
    ]
    found += [
        check for controller in topics.controllers for check in _matched(controller.topic, others, fits, CONTROLLER)
    ]
    found += [_alone(controller.topic, others) for controller in topics.controllers if commands]
    found += _limits(cell) if commands else []
    silence_s, now = cell.safety.limits.silence_s, transport.clock()
    found += [check for each in cell.needed_streams() for check in _arrives(each, each.silent_s(now), silence_s, cell)]
    found += _clock(cell)
    found += [check for each in cell.needed_streams()[1:] for check in _fits_states(each, cell)]
    found += _joints(cell, robot)
    return tuple(found)


@dataclass(frozen=True)
class _Side:
    """What the other program at a topic is, and how to find it."""

    writes: bool
    """Whether it publishes."""
    present: str
    """That it is there."""
    absent: str
    """That it is not."""
    rename: str
    """Where its topic is named."""
    start: str
    """How it starts."""
    change: str
    """What would have to change for its quality to fit."""


DRIVER = _Side(
    writes=True,
    present="is published",
    absent="nobody publishes it",
    rename="name it in the robot's `simulate.ros_names`",
    start="start the driver of the robot",
    change="let the driver publish",
)
CONTROLLER = _Side(
    writes=False,
    present="has a controller",
    absent="nobody reads it",
    rename="name it in `controllers`",
    start="`ros2 control switch_controllers --activate NAME`",
    change="let the controller read",
)


def _matched(
    topic: Topic,
    others: tuple[Endpoint, ...],
    fits: Callable[[Quality, Quality], bool],
    side: _Side,
    *,
    arrives: bool = False,
) -> Iterator[Check]:
    """Whether another program publishes a topic as it is read here, or reads it as it is published here.

    Of several, one has to fit: the others may be recorders, which nothing tells from controllers.
    """
    what = f"{topic.name} {side.present}"
    found = [each for each in others if each.topic == topic.name and each.writes == side.writes]
    if not found and arrives:
        yield Check(what, True, "messages arrive, of a program that the server does not name")
        return
    if not found:
        known = sorted({each.topic for each in others if each.writes == side.writes and each.kind == topic.kind})
        told = f"{side.absent}; of this type: {', '.join(known) or 'none'}"
        yield Check(what, False, told, f"{side.rename}: `{known[0]}`" if known else side.start)
        return
    told = "; ".join(f"{each.kind}, {each.quality or 'any quality'}" for each in found)
    yield Check(what, True, f"{len(found)} {'writer' if side.writes else 'reader'}{'s' * (len(found) > 1)}: {told}")

    def pair(each: Endpoint) -> tuple[Quality, Quality]:
        quality = each.quality or topic.quality
        return (quality, topic.quality) if side.writes else (topic.quality, quality)

    best = max(found, key=lambda each: (each.kind == topic.kind, fits(*pair(each))))
    yield from _fits(topic, best)
    if best.quality is None:
        return
    offered, requested = pair(best)
    yield Check(
        f"{topic.name} quality",
        fits(offered, requested),
        f"offered {offered}, requested {requested}",
        f"{side.change} `{topic.name}` as {topic.quality}",
    )


def _alone(topic: Topic, others: tuple[Endpoint, ...]) -> Check:
    """Whether no other program commands a controller."""
    writers = sum(each.topic == topic.name and each.writes for each in others)
    return Check(
        f"{topic.name} is free",
        not writers,
        f"{writers} other writer" + ("" if writers == 1 else "s"),
        f"end the program that commands it, which `ros2 topic info --verbose {topic.name}` names",
    )


def _limits(cell: RosCell) -> Iterator[Check]:
    """Whether the limits of the cell can be kept."""
    limits = cell.safety.limits
    if limits.force_n is not None:
        told = f"{limits.force_n:g} N cannot be kept, because forces on fingertips are not measured"
        yield Check("limit of force", False, told, "leave `force_n` out of the `limits` of the cell that is given")
    if limits.workspace_m is not None:
        low, high = (listing(f"{each:g}" for each in corner) for corner in limits.workspace_m)
        outside = cell.outside()
        told = outside or f"from {low} to {high} m"
        yield Check("workspace", not outside, told, "move the robot into it, or correct `workspace_m` of `limits`")


def _fits(topic: Topic, other: Endpoint) -> Iterator[Check]:
    """Whether type and type hash agree."""
    yield Check(
        f"{topic.name} type", other.kind == topic.kind, other.kind, f"`{topic.kind}` is needed; name another topic"
    )
    own = hashes.type_hash(topic.kind)
    if other.kind == topic.kind:
        told = other.type_hash or "not stated, as by ROS 2 before Iron and by rosbridge"
        mend = "the robot's definition of the message differs: install the ROS 2 packages of its distribution"
        yield Check(f"{topic.name} type hash", other.type_hash in ("", own), told, mend)


def _arrives(stream: Stream, silent_s: float, most_s: float, cell: RosCell) -> Iterator[Check]:
    """Whether usable messages arrive, and are still arriving."""
    fault = stream.fault or (cell.merged.lacks if stream is cell.state else "")
    if fault:
        yield Check(f"{stream.name} arrives", False, fault, UNNAMED if "lacks" in fault else "see the driver")
    elif silent_s > most_s:
        found = "no message" if stream.last is None else f"no message for {silent_s:.1f} s"
        yield Check(f"{stream.name} arrives", False, found, UNSEEN.format(stream.of) if stream.of else UNHEARD)
    else:
        yield Check(f"{stream.name} arrives", True, f"{stream.count} messages, {stream.rate_hz():.1f} Hz")


def _clock(cell: RosCell) -> Iterator[Check]:
    """Rate of joint states, the delay, and the offset of the robot's clock, which is only reported."""
    state, least_hz = cell.state, LEAST_STATES * cell.rate_hz
    if state.last is None:
        return
    if not state.last.stamp:
        told = "its messages have no stamps, by which they are matched with pictures and commands"
        yield Check(f"{state.name} stamps", False, told, "let the driver fill in `header.stamp`")
        return
    rate = state.rate_hz()
    yield Check(
        "rate of joint states",
        rate >= least_hz,
        f"{rate:.1f} Hz",
        f"raise `update_rate` of the controller manager to {least_hz:g} Hz or more",
    )
    yield _delay(cell.probe(), 1.0 / cell.rate_hz)
    offset = state.offset_s
    remark = "; `chrony` on both machines would set it" if abs(offset) > CLOCK_S else ""
    yield Check("clock", True, f"{1000 * offset:.1f} ms behind this machine's with the delay, corrected{remark}")


def _fits_states(stream: Stream, cell: RosCell) -> Iterator[Check]:
    """Whether pictures and poses can be matched with joint states by their stamps."""
    if stream.last is None or cell.state.last is None or stream.fault or cell.state.fault:
        return
    behind_ms, why = 1000 * (stream.offset_s - cell.state.offset_s), cell.unfit(stream)
    yield Check(
        f"{stream.name} clock",
        not why,
        why or f"{behind_ms:.0f} ms behind joint states of the same stamp",
        "`chrony` on the machine of the camera and on the robot; lower the rate or the size of a camera that is slow",
    )


def _delay(round_trip_s: float | None, period_s: float) -> Check:
    """Whether a command that follows from a measurement arrives before the next measurement does."""
    if round_trip_s is None:
        return Check("delay", True, "not measured: the robot answers on none of the ports that were asked")
    return Check(
        "delay",
        round_trip_s <= period_s,
        f"{1000 * round_trip_s:.1f} ms to the robot and back, {1000 * period_s:g} ms are a control period",
        "a cable instead of a wireless network, `dxb run` nearer to the robot, or a task with a lower `control_hz`",
    )


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

"""The cell of a robot behind a transport: measurements synchronised by stamp, and commands that passed the guard.

After a stop nothing is sent, so that the controllers of the robot hold the last targets.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.robots.cell import Limits
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.deploying import periods, wire
from dextera_build.deploying.bag import INTERVENTIONS, Bag
from dextera_build.deploying.commanders import Commanders
from dextera_build.deploying.encoders import Encoders
from dextera_build.deploying.merged import Merged
from dextera_build.deploying.needed_cameras import NeededCameras
from dextera_build.deploying.stream import SLOW_S, Sample, Stream
from dextera_build.deploying.topics import SIMULATED, STATUS, Commanded, Topics
from dextera_build.deploying.transport import Topic, Transport
from dextera_build.errors import listing
from dextera_build.formats.ros import messages
from dextera_build.formats.ros.reading import SECOND
from dextera_build.policy.cameras import TERMS, term_of
from dextera_build.policy.cell import Guard, Stopped
from dextera_build.policy.observation import Frames, Measurement
from dextera_build.policy.robot_run import REAL, REQUESTED, SENT
from dextera_build.sim.runtime.measured_state import MeasuredState

Sleep = Callable[[float], None]
NEEDED = frozenset({"objects", "displacement", *TERMS})
"""Terms that are read only for policies that take them; points are made of depth."""
SAME = 1e-9
"""Difference of a target from the requested one that is rounding [rad or m]."""
GUARDED = Limits(speed=0.5, silence_s=0.5)
"""Limits of the guard on a robot."""
OFFERED_S = 0.3
"""Time in which controllers learn of the topics on which they are commanded [s]."""
STEP_S = 0.01
"""Time between two looks for the first measurements [s]."""


@dataclass(frozen=True)
class Safety:
    """Limits of a run on a robot; all are in force by default."""

    limits: Limits = GUARDED
    """Limits of the guard; `silence_s` is that of pictures and of poses of objects."""
    periods: float = 2.0
    """Control periods without a joint state after which the robot holds."""
    ramp_s: float = 1.5
    """Time in which the speed limits rise from 0 [s]."""
    late_s: float = 0.2
    """Maximum delay of a joint state beyond the shortest one [s]."""
    answer_s: float = 0.5
    """Maximum time from a measurement to the command that follows from it [s]."""
    skew_s: float = 0.05
    """Maximum difference of the stamps of a picture and the joint state that belongs to it [s]."""
    slow_s: float = SLOW_S
    """Maximum time by which pictures come later than joint states of the same stamp, at their shortest delays [s]."""


class RosCell:
    """A robot that is measured and moved by messages.

    Args:
        transport: Carries the messages.
        topics: Topics of the robot.
        bundle: The task in the twin.
        needed: Channels that the policy takes, of `NEEDED`; of several cameras `rgb/front`, else `rgb` is of all.
        safety: Limits.
        bag: Recording; None: none.
        sleep: Waits [s].
        lenses: Camera -> its intrinsics, for points.
    """

    def __init__(
        self,
        transport: Transport,
        topics: Topics,
        bundle: TaskBundle,
        needed: Collection[str] = (),
        safety: Safety = Safety(),
        bag: Bag | None = None,
        sleep: Sleep = time.sleep,
        lenses: Mapping[str, Camera] | None = None,
    ) -> None:
        self._transport, self._topics, self._bundle, self._bag, self._sleep = transport, topics, bundle, bag, sleep
        self.safety = safety
        self._rows = {name: row for row, name in enumerate(bundle.objects)}
        self._joints = wire.Joints([joint.name for joint in bundle.robot.joints], topics)
        self.merged = Merged(self._joints)
        """Positions of joints from all drivers."""
        self._inner = wire.Joints(bundle.displacement_names, topics)
        self._commanders = Commanders(transport, topics, self._joints)
        self.mirror = MeasuredState(bundle)
        """Judges success by what was measured."""
        self.judges = False
        """Whether all objects were measured at the beginning, so that success can be judged."""
        rate = bundle.task.control_hz
        self._period, self.rate_hz = round(SECOND / rate), rate
        # Those without a stamp would be carried out whenever they arrive.
        self._controllers = [_lasting(each, 1.0 / rate) for each in topics.controllers]
        self._encoders = Encoders(bundle.robot, safety.limits.speed, 1.0 / rate)
        self._guard = Guard(safety.limits, bundle.robot, rate, self.mirror.palms, safety.ramp_s)
        self.previous_action = np.zeros(len(bundle.robot.joints))
        """Joint targets that were sent last (A,) [rad or m]."""
        self.delays_s: list[float] = []
        """Time from the stamp of a joint state to the command that followed from it, beyond the shortest delay [s]."""
        self.interventions = 0
        """Number of control periods in which the guard changed a target."""
        self.state = Stream(topics.joints.name)
        self.objects = {name: Stream(topics.objects.name, of=name, steady=False) for name in bundle.objects}
        self.displacement = Stream(topics.displacement.name, steady=False)
        self._cameras = NeededCameras(topics, needed, lenses or {}, safety.limits.silence_s, safety.skew_s)
        self.pictures, self.depths = self._cameras.pictures, self._cameras.depths
        self.round_trip_s: float | None = None
        """Time of a message to the robot and back, see `probe` [s]; None: it is not known."""
        self.world = REAL
        """World of the robot: `real`, or the one that a simulated robot states."""
        self._needed = {term_of(each) for each in needed} & NEEDED
        if not bundle.displacement_names:
            self._needed.discard("displacement")
        self._listen()

    def probe(self) -> float | None:
        """Measure how long a message takes to the robot and back [s], by which commands are due later; None: unknown.

        It may take seconds, in which nothing may be sent.
        """
        self.round_trip_s = self._transport.round_trip_s()
        return self.round_trip_s

    def offer(self) -> None:
        """Announce the commands, so that the controllers get the first one."""
        for each in self._controllers:
            self._transport.offer(each.topic)
        self._sleep(OFFERED_S)

    def begin(self, limit_s: float = 10.0) -> Measurement:
        """Wait for the first measurements, and begin with the robot where it is.

        Raises:
            Stopped: A topic stays silent, or what it says cannot be used.
        """
        end = self._transport.clock() + round(limit_s * SECOND)
        while silent := self._silent():
            if self._transport.clock() > end:
                lacks = f"; the joint states are not whole: {self.merged.lacks}" if self.merged.lacks else ""
                raise self._guard.stop(f"nothing arrived on {listing(silent)} in {limit_s:g} s{lacks}")
            self._sleep(STEP_S)
        self._check()
        last = self.state.last
        assert last is not None
        self.previous_action = np.array(last.value)
        self._guard.begin(self.previous_action)
        self._encoders.begin(self.previous_action)
        measured = self.measure()
        self.judges = measured.placed
        if self.judges:
            self.mirror.begin(measured)
        return measured

    def _silent(self) -> list[str]:
        """Of what nothing arrived yet."""
        streams = [each for each in self.needed_streams() if not each.fault]
        found = [each.name for each in streams if each.last is None]
        apart = self._cameras.apart() if not found and len(streams) == len(self.needed_streams()) else ""
        return [*found, apart] if apart else found

    def judge(self, measured: Measurement, time_s: float) -> bool | None:
        """Whether a measurement, `time_s` after the beginning [s], shows that the task is done.

        None: an object, or a joint of one, is not measured, or was not at the beginning, with which it is compared.
        """
        return self.mirror.judge(measured, time_s) if self.judges and measured.placed else None

    def measure(self, frames: Frames | None = None) -> Measurement:
        """The newest pictures with the joint state that belongs to them, and the poses of objects measured last.

        Values that were not measured within `silence_s` are NaN.

        Raises:
            Stopped: A measurement is missing, too old, or belongs to no other.
        """
        self._check()
        shown, last = self._cameras.shown(), self.state.last
        assert last is not None
        if apart := self._cameras.apart():
            raise self.stop(f"nothing arrived on {apart}")
        anchor = min((each.stamp for each in shown.values()), default=last.stamp)
        joints = self.state.nearest(anchor) or last
        stamps = [joints.stamp, *(each.stamp for each in shown.values())]
        skew = (max(stamps) - min(stamps)) / SECOND
        if skew > self.safety.skew_s:
            raise self.stop(f"pictures and joint states are {skew:.3f} s apart, more than {self.safety.skew_s:g} s")
        if why := self._encoders.fault(joints.stamp / SECOND, joints.value):
            raise self.stop(why)
        self._anchor, self._measured = joints, self._transport.clock()
        seen = {name: self._cameras.frame(name, shown) for _, name in shown}
        found = Measurement(np.array(joints.value), self._poses(), self._displacement(), {**seen, **(frames or {})})
        if self._bag is not None:
            offset = round(self.state.offset_s * SECOND)
            periods.observed(self._bag, self._measured, self._bundle, found, joints.stamp + offset)
            periods.newest(self._bag, self._measured, self._bundle, last.stamp + offset, last.value)
        return found

    def send(self, targets: np.ndarray) -> np.ndarray:
        """Send joint targets (A,) [rad or m] for one control period; returns the targets sent, within limits.

        Raises:
            Stopped: A limit is exceeded, and nothing was sent.
        """
        self._check()
        now = self._transport.clock()
        if (answer_s := (now - self._measured) / SECOND) > self.safety.answer_s:
            raise self.stop(f"the policy answered after {answer_s:.2f} s, later than {self.safety.answer_s:g} s")
        near = self._near(np.asarray(targets, np.float64))
        try:
            sent = self._guard.passed(near, np.zeros((0, 3)), 0.0)  # `_check` knows the silence of every topic
        except Stopped as stopped:
            self._say(stopped.message)
            raise
        self._intervened(np.asarray(targets, np.float64), sent, now)
        # By the robot's clock, so that a controller refuses what arrives when its time is over, after a network's gap.
        # The offset contains the delay to here, and the delay to there is still to come.
        stamp = now - round(self.state.offset_s * SECOND)
        reach = self._period + round((self.round_trip_s or 0.0) * SECOND)
        for controller in self._controllers:
            command = self._joints.command(stamp, controller, sent, reach)
            self._commanders.sends(controller, command)
            self._transport.publish(controller.topic, command)
            self._record(controller.topic, command, now)
        self.delays_s.append((self._transport.clock() - self._anchor.stamp) / SECOND - self.state.offset_s)
        self.previous_action = sent
        self._encoders.sent(sent, np.asarray(targets, np.float64))
        return sent

    def _near(self, targets: np.ndarray) -> np.ndarray:
        """Targets (A,) no farther ahead of the joints than these follow; the guard refuses those of another shape."""
        last = self.state.last
        if last is None or targets.shape != last.value.shape:
            return targets
        return self._encoders.near(targets, last.value, self.round_trip_s or 0.0)

    def stop(self, why: str) -> Stopped:
        """Stop, here or for a reason from outside, such as the operator; returns what to raise."""
        stopped = self._guard.stop(why)
        self._say(stopped.message)
        return stopped

    def outside(self) -> str:
        """Which palm is not in the workspace now; empty if all are."""
        last = self.state.last
        return "" if last is None else self._guard.outside(np.array(last.value))

    def tell(self, words: str) -> None:
        """Publish what the run does, for the robot and its operators."""
        message = messages.text(words)
        self._transport.publish(STATUS, message)
        self._record(STATUS, message, self._transport.clock())

    def needed_streams(self) -> list[Stream]:
        """Streams that the policy needs."""
        found = [self.state]
        found += self.objects.values() if "objects" in self._needed else []
        found += [self.displacement] if "displacement" in self._needed else []
        return [*found, *self._cameras.streams.values()]

    def unfit(self, stream: Stream) -> str:
        """How the stamps of a camera, or of a tracker, do not fit those of joint states; empty if they do."""
        camera = stream in self._cameras.streams.values()
        return stream.unfit(self.state, slow_s=self.safety.slow_s if camera else float("inf"))

    def _listen(self) -> None:
        topics, subscribe = self._topics, self._transport.subscribe
        for topic in topics.states:
            subscribe(topic, partial(self._joined, topic))
        subscribe(
            topics.displacement, partial(self._heard, topics.displacement, self.displacement, self._inner.positions)
        )
        subscribe(topics.objects, self._placed)
        subscribe(SIMULATED, self._stated)
        for camera, topic in topics.pictures.items():
            subscribe(topic, partial(self._shown, "rgb", camera, topic))
        for camera, topic in topics.depths.items():
            if ("depth", camera) in self._cameras.channels:
                subscribe(topic, partial(self._shown, "depth", camera, topic))

    def _stated(self, message: bytes, arrived: int) -> None:
        self._record(SIMULATED, message, arrived)
        with suppress(wire.UnusableError):
            self.world = str(wire.unpacked(SIMULATED.kind, message).data)

    def _heard(self, topic: Topic, stream: Stream, read: Callable[[Any], Any], message: bytes, arrived: int) -> Any:
        """Add what `read` finds in a message to its stream, and return it; None if the message is of no use."""
        self._record(topic, message, arrived)
        try:
            found = wire.unpacked(topic.kind, message)
            sample = Sample(wire.stamp_of(found.header), arrived, read(found))
            stream.add(sample)
        except wire.UnusableError as error:
            stream.broken(str(error))
            return None
        return sample.value

    def _joined(self, topic: Topic, message: bytes, arrived: int) -> None:
        self._record(topic, message, arrived)
        self.merged.read(topic.kind, message, arrived, self.state)

    def _placed(self, message: bytes, arrived: int) -> None:
        self._record(self._topics.objects, message, arrived)
        try:
            found = wire.placed(
                wire.unpacked(self._topics.objects.kind, message), self._topics.names.base, self.objects
            )
        except wire.UnusableError as error:
            for stream in self.objects.values():
                stream.broken(str(error))
            return
        for name, (stamp, pose) in found.items():
            self.objects[name].add(Sample(stamp, arrived, pose))

    def _shown(self, term: str, camera: str, topic: Topic, message: bytes, arrived: int) -> None:
        stream = self.pictures[camera] if term == "rgb" else self.depths[camera]
        picture = self._heard(topic, stream, _whole, message, arrived)
        if picture is not None:
            last = self.state.last
            joints = None if last is None else last.value
            self._cameras.watch(term, camera, bytes(picture.data), arrived, joints)

    def _check(self) -> None:
        """Raise if the measurements or the recording are of no use."""
        now = self._transport.clock()
        why = next((each.fault for each in self.needed_streams() if each.fault), "")
        why = (
            why or self._transport.fault or self._commanders.fault or (self._bag.fault if self._bag is not None else "")
        )
        most = self.safety.periods / self.rate_hz
        if not why and self.state.silent_s(now) > most:
            why = f"no joint states{self.merged.silent(now - round(most * SECOND))} arrived for more than {most:g} s"
        if not why and (late_s := self.state.late_s()) > self.safety.late_s:
            why = f"joint states arrive {late_s:.2f} s late, more than {self.safety.late_s:g} s"
        others, most_s = self.needed_streams()[1:], self.safety.limits.silence_s
        why = why or next(filter(None, (self.unfit(each) or each.old(now, most_s) for each in others)), "")
        if why:
            raise self.stop(why)

    def _intervened(self, wanted: np.ndarray, sent: np.ndarray, now: int) -> None:
        """Record the targets, and which of them the guard changed."""
        if self._bag is not None:
            periods.commanded(self._bag, now, self._bundle, self._period, {REQUESTED: wanted, SENT: sent})
        names = [joint.name for joint in self._bundle.robot.joints]
        changed = np.flatnonzero(np.abs(wanted - sent) > SAME)
        if len(changed):
            self.interventions += 1
            self._say(", ".join(f"{names[row]} {wanted[row]:.4f} to {sent[row]:.4f}" for row in changed))

    def _say(self, words: str) -> None:
        if self._bag is not None:
            self._bag.say(INTERVENTIONS, self._transport.clock(), words)

    def _record(self, topic: Topic, message: bytes, time_ns: int) -> None:
        if self._bag is not None:
            self._bag.add(topic, time_ns, message)

    def _poses(self) -> np.ndarray:
        found = np.full((len(self._rows), 7), np.nan)
        for name, stream in self.objects.items():
            if (last := self._fresh(stream)) is not None:
                found[self._rows[name]] = last.value
        return found

    def _displacement(self) -> np.ndarray:
        last = self._fresh(self.displacement)
        return np.full(len(self._bundle.displacement_names), np.nan) if last is None else np.array(last.value)

    def _fresh(self, stream: Stream) -> Sample | None:
        """The newest measurement of a stream; None if it is too old, or the stream has a fault."""
        old = bool(stream.fault) or stream.age_s(self._transport.clock()) > self.safety.limits.silence_s
        return None if old else stream.last


def _lasting(controller: Commanded, lifespan_s: float) -> Commanded:
    """A controller whose commands are not sent again after some time."""
    topic = controller.topic
    return replace(controller, topic=replace(topic, quality=replace(topic.quality, lifespan_s=lifespan_s)))


def _whole(message: Any) -> Any:
    """A message that is a measurement as it is."""
    return message

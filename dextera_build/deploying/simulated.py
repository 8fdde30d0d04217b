"""A simulated world behind the topics of a robot: joint states, pictures, poses of objects, commands, and faults.

It replaces a robot where none is available. Encoders, clock and network are simulated; effects of hardware, such as
brakes, protective stops and loose cables, are not.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import mujoco
import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.deploying import wire
from dextera_build.deploying.apart import Apart
from dextera_build.deploying.faults import JUMP_NS, LATE_S, LOST, Fault, FaultKind
from dextera_build.deploying.plans import Command, Plans
from dextera_build.deploying.topics import SIMULATED, STATUS, Commanded, Topics, beside, offered
from dextera_build.deploying.transport import SENSOR, Topic, Transport
from dextera_build.formats.ros import hashes, messages
from dextera_build.formats.ros.reading import SECOND
from dextera_build.formats.ros.recording import packed
from dextera_build.policy import robot_run
from dextera_build.policy.features import counts
from dextera_build.policy.layout import of_bundle
from dextera_build.policy.observation import Frames
from dextera_build.sim.model.compose import ROBOT
from dextera_build.sim.runtime.environment import Environment

STATE_HZ = 100.0
"""Joint states per second [Hz]."""


@dataclass(frozen=True)
class Simulation:
    """Properties of the simulated robot's sensors and network."""

    picture_hz: float = 15.0
    """Pictures and poses of objects per second [Hz]."""
    delay_s: float = 0.0
    """Delay of commands [s]."""
    loss: float = 0.02
    """Fraction of poses, of pictures and of depth that is lost, 0..1."""
    depth_s: float = 0.01
    """Time by which depth comes later than its picture, as from drivers that register it [s]."""
    tracks: bool = True
    """Whether poses of objects are published, as by a tracker; false: a tracker has to find them in the pictures."""
    clock_s: float = 0.0
    """Time by which the clock of the stamps is ahead [s]."""
    faults: tuple[Fault, ...] = ()
    """Things that go wrong."""
    seed: int = 0
    """Seed of losses."""


@dataclass
class Heard:
    """What the robot received."""

    commands: int = 0
    """Number of commands."""
    expired: int = 0
    """Number of trajectories that ended in the past, which the JointTrajectory controller of ros2_control refuses."""
    after_stop: int = 0
    """Number of other commands after the run said that it stopped."""
    unusable: list[str] = field(default_factory=list)
    """Why commands were refused."""
    status: list[str] = field(default_factory=list)
    """What the run said."""
    last_ns: int = 0
    """When the last command arrived [ns]."""
    faults: dict[FaultKind, int] = field(default_factory=dict)
    """Fault -> when it began [ns]."""


class SimulatedRobot:
    """Advances a world by 10 ms at a time, with the messages that belong to it.

    Args:
        transport: Carries the messages.
        topics: Topics of the robot.
        environment: The world, in which an episode was begun.
        simulation: Sensors and network.
        look: Gives the frames of the current state by the cameras of `topics`, at once or apart; None: there is none.
        camera: Its intrinsics, which are published with the pictures; None: they are not.
    """

    def __init__(
        self,
        transport: Transport,
        topics: Topics,
        environment: Environment,
        simulation: Simulation = Simulation(),
        look: Callable[[], Frames] | Apart | None = None,
        camera: Camera | None = None,
    ) -> None:
        self._transport, self._topics, self.environment = transport, topics, environment
        self._simulation, self._look, self._camera = simulation, look, camera
        robot = environment.bundle.robot
        self._names = [joint.name for joint in robot.joints]
        self._joints = wire.Joints(self._names, topics)
        self._inner = wire.Joints(environment.bundle.displacement_names, topics)
        self._actuators = np.array([environment.model.actuator(ROBOT + name).id for name in self._names])
        self._steps = max(1, round(1.0 / STATE_HZ / environment.model.opt.timestep))
        self._every = max(1, round(STATE_HZ / environment.task.control_hz))
        self._pictures = max(1, round(STATE_HZ / simulation.picture_hz))
        self._random = np.random.default_rng(simulation.seed)
        self._plans = Plans(self._names, environment.previous_action)
        self._waiting: deque[tuple[int, Command]] = deque()
        self._states: deque[tuple[int, bytes]] = deque()
        self._depths: deque[tuple[int, Topic, bytes]] = deque()
        self._shown: dict[str, tuple[bytes, np.ndarray | None]] = {}
        self._ticks, self._moving_since = 0, -1
        self.heard = Heard()
        self.success = False
        """Whether the true state shows that the task is done."""
        for controller in topics.controllers:
            transport.subscribe(controller.topic, partial(self._commanded, controller))
        transport.subscribe(STATUS, self._told)
        transport.publish(SIMULATED, messages.text(environment.bundle.kind))

    def tick(self) -> None:
        """Advance by 10 ms, and publish what is due."""
        environment = self.environment
        self._obey()
        environment.data.ctrl[self._actuators] = self._setpoint()
        mujoco.mj_step(environment.model, environment.data, self._steps)
        self._ticks += 1
        if self._ticks % self._every == 0:
            mujoco.mj_forward(environment.model, environment.data)
            self.success = self.success or environment.conclude(self._setpoint()).success
        if self._faulty("cut"):
            return
        stamp = self._stamp()
        self._tell_state(stamp)
        if self._ticks % self._pictures == 0:
            mujoco.mj_forward(environment.model, environment.data)
            self._see(stamp)
        while self._depths and self._depths[0][0] <= self._ticks:
            self._transport.publish(*self._depths.popleft()[1:])

    def _arrives(self) -> bool:
        """Whether a picture, or what a tracker says of it, is not lost."""
        return bool(self._random.uniform() >= self._simulation.loss)

    def _clock(self) -> int:
        """The robot's clock [ns]."""
        return self._transport.clock() + round(self._simulation.clock_s * SECOND)

    def _stamp(self) -> int:
        stamp = self._clock()
        stamp += JUMP_NS if self._faulty("stamps_jump") else 0
        return stamp - (JUMP_NS if self._faulty("stamps_back") else 0)

    def _tell_state(self, stamp: int) -> None:
        """Publish the joint states that are due, the present one or those that were held back."""
        lost = self._faulty("joint_states_lost") and self._random.uniform() < LOST
        if not (lost or self._faulty("joint_states_stop")):
            held = round(LATE_S * STATE_HZ) if self._faulty("joint_states_late") else 0
            self._states.append((self._ticks + held, self._state(stamp)))
        while self._states and self._states[0][0] <= self._ticks:
            state = self._states.popleft()[1]
            for topic in self._topics.states:
                self._transport.publish(offered(topic), state)

    def _state(self, stamp: int) -> bytes:
        positions = self.environment.measure().joints
        if self._faulty("nan"):
            positions[0] = np.nan
        if self._faulty("sign_flipped"):
            positions[0] *= -1.0
        whole = self._joints.state(stamp, positions)
        if not (self._faulty("joint_missing") or self._faulty("joint_renamed")):
            return whole
        read = hashes.read(self._topics.joints.kind, whole)
        first = 1 if self._faulty("joint_missing") else 0
        names = [*read.name[first:]]
        if self._faulty("joint_renamed"):
            names[0] += "_2"
        return messages.joint_state(stamp, names, read.position[first:])

    def _see(self, stamp: int) -> None:
        bundle, seen = self.environment.bundle, self.environment.measure()
        if self._simulation.tracks and self._arrives() and not self._faulty("poses_stop"):
            placed = dict(zip(bundle.objects, seen.objects, strict=True))
            tracked = wire.poses(stamp, self._topics.names.base, placed)
            self._transport.publish(offered(self._topics.objects), tracked)
            if len(seen.displacement):
                inner = self._inner.state(stamp, seen.displacement)
                self._transport.publish(offered(self._topics.displacement), inner)
        if self._look is None or self._faulty("pictures_stop"):
            return
        if self._shown and self._faulty("pictures_freeze"):
            self._tell_frames(stamp)
        elif isinstance(self._look, Apart):
            self._look.ask(partial(self._show, stamp))
        else:
            self._show(stamp, self._look())

    def _show(self, stamp: int, frames: Frames) -> None:
        """Publish frames, in the thread that made them."""
        self._shown = {name: (packed(np.asarray(frame.rgb), "jpeg"), frame.depth) for name, frame in frames.items()}
        if not self._faulty("cut"):
            self._tell_frames(stamp)

    def _tell_frames(self, stamp: int) -> None:
        for camera, (picture, depth) in self._shown.items():
            topic = self._topics.pictures[camera]
            if self._arrives():
                self._transport.publish(topic, messages.compressed_image(stamp, camera, "jpeg", picture))
            if self._camera is not None:
                info = Topic(beside(topic.name), "sensor_msgs/CameraInfo", SENSOR)
                self._transport.publish(info, messages.camera_info(stamp, camera, self._camera))
            if depth is not None and self._arrives():
                message = messages.depth_image(stamp, camera, counts(depth))
                due = self._ticks + round(self._simulation.depth_s * STATE_HZ)
                self._depths.append((due, self._topics.depths[camera], message))

    def _commanded(self, controller: Commanded, message: bytes, arrived: int) -> None:
        if self._faulty("cut"):
            return
        try:
            command = self._joints.commanded(controller, message)
        except wire.UnusableError as error:
            self.heard.unusable.append(str(error))
            return
        self.heard.commands, self.heard.last_ns = self.heard.commands + 1, arrived
        if command.stamp and max(command.due_s(self._clock()), default=0.0) < 0.0:
            self.heard.expired += 1
            return
        self.heard.after_stop += bool(self.heard.status) and self.heard.status[-1].startswith(robot_run.STOPPED)
        if self._moving_since < 0:
            self._moving_since = self._ticks
        delay = round(self._simulation.delay_s * SECOND)
        late = replace(command, stamp=command.stamp + delay if command.stamp else 0)
        self._waiting.append((arrived + delay, late))

    def _told(self, message: bytes, arrived: int) -> None:
        self.heard.status.append(hashes.read(STATUS.kind, message).data)

    def _obey(self) -> None:
        """Take the commands whose delay is over."""
        now = self._transport.clock()
        while self._waiting and self._waiting[0][0] <= now:
            self._plans.follow(self._waiting.popleft()[1], self._clock(), self._plans.at(self._clock()))

    def _setpoint(self) -> np.ndarray:
        """Targets (A,) at the end of this tick [rad or m]."""
        return self._plans.at(self._clock() + round(SECOND / STATE_HZ))

    def _faulty(self, kind: FaultKind) -> bool:
        if self._moving_since < 0:
            return False
        moving = (self._ticks - self._moving_since) / STATE_HZ
        found = any(
            each.kind == kind and each.at_s <= moving < each.at_s + each.for_s for each in self._simulation.faults
        )
        if found:
            self.heard.faults.setdefault(kind, self._transport.clock())
        return found


def facts(robot: SimulatedRobot) -> dict[str, Any]:
    """What happened to a simulated robot, as plain data."""
    heard = robot.heard
    layout = of_bundle(robot.environment.bundle)
    places = robot.environment.measure().joints.tolist()
    return {
        "task": layout.task,
        "world": layout.world,
        "commands": heard.commands,
        "commands_expired": heard.expired,
        "commands_after_stop": heard.after_stop,
        "unusable": heard.unusable[:5],
        "status": heard.status[-5:],
        "last_command_after_fault_s": {kind: (heard.last_ns - at) / SECOND for kind, at in heard.faults.items()},
        "joints": dict(zip(layout.joints, places, strict=True)),
        "success": robot.success,
    }

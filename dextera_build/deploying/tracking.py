"""The tracker of a robot: poses of a task's objects from one RGB-D camera, published as any tracker would publish them.

It is a program of its own, so that a frame delays no control period. Poses have the stamp of the frame in which they
were seen. No pose is published of a lost object, and a policy that needs it is stopped.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.deploying import wire
from dextera_build.deploying.merged import Merged
from dextera_build.deploying.stream import KEPT_S, Sample, Stream
from dextera_build.deploying.topics import Topics, beside, offered
from dextera_build.deploying.transport import SENSOR, Topic, Transport
from dextera_build.errors import ArtifactError, MachineError
from dextera_build.formats.ros import images
from dextera_build.formats.ros.reading import SECOND
from dextera_build.policy.observation import Measurement
from dextera_build.sim.runtime.cell_tracker import AWAY_S, PHOTOGRAPHED, CellTracker, Found
from dextera_build.tracking.tracked_object import Status

TOGETHER_NS = SECOND // 50
"""Largest difference of the stamps of a picture and its depth [ns], which drivers that register depth make equal."""
NEAR_NS = SECOND // 10
"""Largest difference of the stamps of a picture and the joint state that belongs to it [ns]."""
UNFIT_S = 5.0
"""Time after which stamps that do not fit are told [s]."""
ALIVE_S = 1.0
"""Time without a message after which a topic is silent [s]; what is silent is waited for."""
FRAMES_S = 0.5
"""Time for which pictures and depth are kept [s]."""
FRAME_S = 1 / 15
"""Time between the frames in which the photographed scene is shown [s]."""


class Watched:
    """The newest frame of a camera with the joint state of its time.

    Args:
        transport: Carries the messages.
        topics: Topics of the robot, with one camera.
        bundle: The task.
    """

    def __init__(self, transport: Transport, topics: Topics, bundle: TaskBundle) -> None:
        ((name, picture),) = topics.pictures.items()
        depth = topics.depths[name]
        self.info = info_of(topics, name)
        """Topic with the intrinsics."""
        self.camera: Camera | None = None
        """Intrinsics of the pictures; None before they arrived."""
        self._picture, self._depth = _stream(picture, FRAMES_S), _stream(depth, FRAMES_S)
        self._state = _stream(topics.joints)
        self._merged = Merged(wire.Joints([joint.name for joint in bundle.robot.joints], topics))
        self._shown: Sample | None = None
        self._clock, self._transport = transport.clock, transport
        self._unfit_since: int | None = None
        self._fault = ""
        for each in topics.states:
            transport.subscribe(each, partial(self._merged.read, each.kind, into=self._state))
        transport.subscribe(picture, partial(self._heard, picture, self._picture, _whole))
        transport.subscribe(depth, partial(self._heard, depth, self._depth, _whole))
        transport.subscribe(self.info, self._informed)

    def missing(self) -> list[str]:
        """Topics on which nothing arrived.

        Raises:
            MachineError: What arrived cannot be used.
        """
        self._check()
        silent = [each.topic for each in (self._picture, self._depth, self._state) if each.last is None]
        if self._state.topic in silent and self._merged.lacks:
            silent[silent.index(self._state.topic)] += f" ({self._merged.lacks})"
        return silent + ([] if self.camera else [self.info.name])

    def frame(self) -> tuple[int, np.ndarray, np.ndarray, np.ndarray] | None:
        """Stamp [ns], picture (H, W, 3) uint8, depth (H, W) [m] and joints (A,) of the newest frame; None: no new one.

        Raises:
            MachineError: What arrived cannot be used.
        """
        self._check()
        depth, camera = self._depth.last, self.camera
        picture = None if depth is None else self._picture.nearest(depth.stamp)
        if depth is None or picture is None or camera is None or depth is self._shown:
            return None
        state = self._state.nearest(picture.stamp)
        if state is None:
            return None
        if why := self._unfit(picture, depth, state):
            self._tell_unfit(why)
            return None
        self._shown, self._unfit_since = depth, None
        try:
            rgb = images.pixels(picture.value, self._picture.topic)
            metres = images.depths(depth.value, self._depth.topic)
        except ArtifactError as error:
            raise _unusable(error.message) from None
        size = camera.height, camera.width
        if (rgb.shape[:2], metres.shape) != (size, size):
            shapes = " and ".join(f"{each.shape[1]} x {each.shape[0]}" for each in (rgb, metres))
            raise _unusable(f"pictures and depth are {shapes} px, `{self.info.name}` says {size[1]} x {size[0]}")
        return picture.stamp, rgb, metres, np.array(state.value)

    def _unfit(self, picture: Sample, depth: Sample, state: Sample) -> str:
        """Why these are not of one time; empty if they are."""
        if (apart := abs(picture.stamp - depth.stamp)) > TOGETHER_NS:
            return f"a picture and its depth are {apart / SECOND:.3f} s apart"
        if (apart := abs(picture.stamp - state.stamp)) > NEAR_NS:
            return f"pictures and joint states are {apart / SECOND:.3f} s apart"
        return self._picture.unfit(self._state)

    def _tell_unfit(self, why: str) -> None:
        """Raise once nothing fits although everything arrives."""
        now = self._clock()
        if any(each.silent_s(now) > ALIVE_S for each in self._streams()):
            self._unfit_since = None
        elif self._unfit_since is None:
            self._unfit_since = now
        elif (now - self._unfit_since) / SECOND > UNFIT_S:
            raise _unusable(f"for {UNFIT_S:g} s, {why}")

    def _check(self) -> None:
        fault = self._fault or self._transport.fault or next((each.fault for each in self._streams() if each.fault), "")
        if fault:
            raise _unusable(fault)

    def _streams(self) -> tuple[Stream, ...]:
        return self._picture, self._depth, self._state

    def _heard(self, topic: Topic, stream: Stream, read: Any, message: bytes, arrived: int) -> None:
        try:
            found = wire.unpacked(topic.kind, message)
            stream.add(Sample(wire.stamp_of(found.header), arrived, read(found)))
        except wire.UnusableError as error:
            stream.broken(str(error))

    def _informed(self, message: bytes, arrived: int) -> None:
        try:
            self.camera = intrinsics(self.info, message)
        except wire.UnusableError as error:
            self._fault = str(error)


class ObjectTracker:
    """Publishes the poses of a task's objects and the positions of their joints.

    Args:
        transport: Carries the messages.
        topics: Topics of the robot.
        bundle: The task in the twin.
        tracker: Opened.
        scene: The photographed scene in its camera: colours (H, W, 3) uint8 and depth (H, W) [m].
    """

    def __init__(
        self,
        transport: Transport,
        topics: Topics,
        bundle: TaskBundle,
        tracker: CellTracker,
        scene: tuple[np.ndarray, np.ndarray],
    ) -> None:
        self._transport, self._topics, self._bundle, self._tracker = transport, topics, bundle, tracker
        self._inner = wire.Joints(bundle.displacement_names, topics)
        self._known = tracker.photographed(np.array([joint.home for joint in bundle.robot.joints]))
        self._stamp, self._time = 0, 0.0
        self.status: dict[str, Status] = dict.fromkeys(tracker.names, "lost")
        """Object -> its status in the last frame."""
        self.why: dict[str, str] = {}
        """Object -> why it was not measured in the last frame, of those that were not."""
        self.frames = 0
        """Number of frames."""
        for number in range(PHOTOGRAPHED):
            tracker.step(*scene, (number - PHOTOGRAPHED) * FRAME_S, self._known)

    def step(self, stamp: int, rgb: np.ndarray, depth: np.ndarray, joints: np.ndarray) -> None:
        """Track the objects in a frame, see `Watched.frame`, and publish where they are."""
        passed = (stamp - self._stamp) / SECOND if self._stamp else AWAY_S
        # Stamps go back where the clock of the camera was set.
        self._stamp, self._time = stamp, self._time + (passed if passed > 0 else FRAME_S)
        self._known = Measurement(joints, self._known.objects, self._known.displacement)
        found = self._tracker.step(rgb, depth, self._time, self._known)
        self._tracker.put(found, self._known)
        self.frames += 1
        self.status = {name: each.status for name, each in found.items()}
        self.why = {name: each.why for name, each in found.items() if each.status != "tracked"}
        self._tell(stamp, found)

    def _tell(self, stamp: int, found: Found) -> None:
        known = [name for name, each in found.items() if each.pose is not None]
        placed = {name: self._known.objects[self._tracker.row(name)] for name in known}
        if placed:
            message = wire.poses(stamp, self._topics.names.base, placed)
            self._transport.publish(offered(self._topics.objects), message)
        # One message has all joints: with one of them unknown, none is told.
        jointed = [name for name, thing in self._bundle.objects.items() if thing.joints]
        if jointed and set(jointed) <= placed.keys():
            message = self._inner.state(stamp, self._known.displacement)
            self._transport.publish(offered(self._topics.displacement), message)


def info_of(topics: Topics, camera: str) -> Topic:
    """The topic with the intrinsics of a camera."""
    return Topic(beside(topics.pictures[camera].name), "sensor_msgs/CameraInfo", SENSOR)


def intrinsics(info: Topic, message: bytes) -> Camera:
    """The intrinsics that a message of `info_of` states.

    Raises:
        UnusableError: It is damaged, or pictures are not rectified.
    """
    found = wire.unpacked(info.kind, message)
    fx, _, cx, _, fy, cy, *_ = (float(each) for each in found.k)
    if np.any(found.d) or not (fx > 0 and fy > 0 and np.isfinite([fx, fy, cx, cy]).all()):
        raise wire.UnusableError(f"`{info.name}` has a distortion, or no focal length; rectified pictures are needed")
    if not (found.width and found.height):
        raise wire.UnusableError(f"`{info.name}` states no size of the pictures")
    return Camera(width=int(found.width), height=int(found.height), fx=fx, fy=fy, cx=cx, cy=cy)


def _stream(topic: Topic, kept_s: float = KEPT_S) -> Stream:
    """Measurements whose clock may be set: the cell that moves the robot stops then, and begins anew, too."""
    return Stream(topic.name, kept_s, strict=False)


def _whole(message: Any) -> Any:
    """A message that is a measurement as it is."""
    return message


def _unusable(why: str) -> MachineError:
    return MachineError(f"the tracker cannot go on: {why}", code="DXB-E444", hint="see the driver of the camera")

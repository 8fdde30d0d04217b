"""The direction in which things fall, in the frame of a camera, from the inertial sensor of a recording."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from dextera_build.artifacts.robots.stream import Stream
from dextera_build.formats import mcap
from dextera_build.geometry import transforms
from dextera_build.rule import Context

from .topics import CameraTopics, in_common

WITHIN_S = 0.25
"""Accelerations up to this time from a picture are averaged [s]."""
FALL_M_S2 = 9.81
"""What an accelerometer at rest reads, upwards [m/s^2]."""
OFF = 0.1
"""Largest error of the mean's length at rest, and deviation of single readings, as fractions of `FALL_M_S2`: a bias is
below 2 % for the sensors of depth cameras, and a camera that is carried shakes by more than 10 %."""

Edges = Mapping[tuple[str, str], np.ndarray]


class Imu(NamedTuple):
    """An inertial sensor."""

    topic: str
    turn: np.ndarray  # (3, 3) R_camera_imu


def at(ctx: Context, stream: Stream, topics: CameraTopics, stamps: np.ndarray) -> dict[int, tuple[float, float, float]]:
    """Number of a picture -> unit direction of gravity in the camera's frame, where the sensor was at rest.

    Args:
        ctx: Context for warnings.
        stream: Recording of the camera and of the inertial sensor.
        topics: The camera's topics.
        stamps: (K,) times of the pictures [s].
    """
    imu = _imu(ctx, stream, topics)
    if imu is None:
        return {}
    rows = mcap.accelerations(stream, imu.topic)
    found: dict[int, tuple[float, float, float]] = {}
    for number, stamp in enumerate(stamps):
        down = _down(rows[np.abs(rows[:, 0] - stamp) <= WITHIN_S, 1:])
        if down is not None:
            x, y, z = (float(each) for each in imu.turn @ down)
            found[number] = (x, y, z)
    if len(found) < len(stamps):
        ctx.warn(
            f"{len(stamps) - len(found)} of {len(stamps)} pictures have no gravity from `{imu.topic}`: within "
            f"{1000 * WITHIN_S:.0f} ms it was moved, or did not read {FALL_M_S2} m/s²"
        )
    return found


def of_reference(stream: Stream, topic: str) -> np.ndarray | None:
    """(4, 4) T_sensor_reference of a topic of librealsense, from its `tf/0` topic; None if there is none."""
    top = topic.rsplit("/", 2)[0]
    known = [each.topic for each in stream.channels if each.topic.startswith(f"{top}/tf/")]
    return mcap.transform(stream, known[0]) if len(known) == 1 else None


def _down(accelerations: np.ndarray) -> np.ndarray | None:
    """Unit direction (3,) of gravity from the readings (N, 3) [m/s^2] of a sensor at rest; None if it is not."""
    if not len(accelerations):
        return None
    mean = accelerations.mean(axis=0)
    length = float(np.linalg.norm(mean))
    shaken = float(np.linalg.norm(accelerations - mean, axis=1).mean())
    if max(abs(length - FALL_M_S2), shaken) > OFF * FALL_M_S2:
        return None
    return np.asarray(-mean / length)


def _imu(ctx: Context, stream: Stream, topics: CameraTopics) -> Imu | None:
    """The sensor whose axes are known in the camera's frame; of several, the one with the most in common by name."""
    known = [each.topic for each in stream.channels if each.kind in mcap.IMUS and each.count]
    known.sort(key=lambda topic: (-in_common(topic, topics.image), "accel" not in topic.lower(), topic))
    edges = _edges(stream)
    for topic in known:
        turn = _turn(stream, topics.image, topic, edges)
        if turn is not None:
            return Imu(topic, turn)
    if known:
        ctx.warn(
            f"how `{known[0]}` is mounted is not recorded, so gravity is not used: record `/tf_static` with frames "
            f"`{mcap.frame(stream, topics.image)}` and `{mcap.frame(stream, known[0])}`"
        )
    return None


def _turn(stream: Stream, image: str, imu: str, edges: Edges) -> np.ndarray | None:
    """R_camera_imu (3, 3) by equal frames, by a chain of transforms, or by those of librealsense."""
    camera, sensor = mcap.frame(stream, image), mcap.frame(stream, imu)
    to_camera, to_sensor = of_reference(stream, image), of_reference(stream, imu)
    if to_camera is not None and to_sensor is not None:
        return np.asarray((to_camera @ transforms.invert(to_sensor))[:3, :3])
    if camera and camera == sensor:
        return np.eye(3)
    chained = _chain(camera, sensor, edges)
    return None if chained is None else np.asarray(chained[:3, :3])


def _chain(start: str, end: str, edges: Edges) -> np.ndarray | None:
    """T_start_end (4, 4) along transforms between frames; None if they are not connected."""
    both = {**edges, **{(child, parent): transforms.invert(motion) for (parent, child), motion in edges.items()}}
    reached, ahead = {start: np.eye(4)}, [start]
    while ahead:
        here = ahead.pop()
        for (parent, child), motion in both.items():
            if parent == here and child not in reached:
                reached[child] = reached[here] @ motion
                ahead.append(child)
    return reached.get(end)


def _edges(stream: Stream) -> dict[tuple[str, str], np.ndarray]:
    found: dict[tuple[str, str], np.ndarray] = {}
    for each in stream.channels:
        if each.kind in mcap.FRAMES and each.topic.endswith("tf_static"):
            found |= mcap.frames(stream, each.topic)
    return found

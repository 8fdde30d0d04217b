"""`Stream` as MCAP: messages of ROS 2 or Foxglove, read by topic and time, and written."""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from dextera_build.artifacts.base import File
from dextera_build.artifacts.cameras.lens import Lens
from dextera_build.artifacts.core.file_errors import unreadable
from dextera_build.artifacts.robots.stream import Channel, Stream
from dextera_build.artifacts.spatial.joints import Joints
from dextera_build.artifacts.spatial.trajectory import Trajectory
from dextera_build.errors import ArtifactError, listing
from dextera_build.formats import camera_info
from dextera_build.formats import lens as lens_files
from dextera_build.formats.files import suffix_among
from dextera_build.formats.ros import images, messages, reading
from dextera_build.formats.ros.recording import Recording, packed
from dextera_build.formats.stamped_rows import unit
from dextera_build.geometry import poses as matrices

JOINTS = (
    "sensor_msgs/msg/JointState",
    "sensor_msgs/JointState",
    "foxglove.JointStates",
    "foxglove_msgs/msg/JointStates",
)
POSES = ("geometry_msgs/msg/PoseStamped", "geometry_msgs/PoseStamped", "foxglove.PoseInFrame")
PICTURES = (
    *("sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/Image", "sensor_msgs/CompressedImage", "sensor_msgs/Image"),
    *("foxglove.CompressedImage", "foxglove.RawImage"),
    *("foxglove_msgs/msg/CompressedImage", "foxglove_msgs/msg/RawImage"),
)
LENSES = (
    *("sensor_msgs/msg/CameraInfo", "sensor_msgs/CameraInfo"),
    *("foxglove.CameraCalibration", "foxglove_msgs/msg/CameraCalibration"),
)
"""Equivalent message types of ROS 2, JSON and Foxglove."""
TRANSFORMS = ("geometry_msgs/msg/Transform", "geometry_msgs/Transform")
IMUS = ("sensor_msgs/msg/Imu", "sensor_msgs/Imu")
FRAMES = ("tf2_msgs/msg/TFMessage", "tf2_msgs/TFMessage")
_MODELS = {"Brown Conrady": "plumb_bob", "None": "plumb_bob"}
"""Names of lens models in librealsense -> in ROS."""


@dataclass(frozen=True)
class Pictures:
    """Pictures for a recording, generated one by one.

    Args:
        frames: Pairs of a time [s] and pixels (H, W, 3) uint8 sRGB, in order of time.
        frame: Name of the camera's frame.
        form: Encoding; `png` is lossless.
    """

    frames: Iterable[tuple[float, np.ndarray]]
    frame: str
    form: Literal["png", "jpeg"] = "png"


def of(file: File, name: str = "recording.mcap") -> Stream:
    """The recording in an MCAP file; only its index is read.

    Args:
        file: The file.
        name: Its name, for errors.

    Raises:
        ArtifactError: It is no MCAP file, or has no index.
    """
    with file.open() as opened:
        found, start, end = reading.index(opened, name)
    channels = tuple(Channel(**asdict(each)) for each in found)
    return Stream(file=file, channels=channels, start_ns=start, end_ns=end)


def load(path: str | Path) -> Stream:
    """Open an `.mcap` file, which must no longer change.

    Raises:
        ArtifactError: There is no such file, it is no MCAP file, or has no index.
    """
    suffix_among("Stream", Path(path), (".mcap",))
    if not Path(path).is_file():
        raise unreadable(path, "MCAP", "there is no such file")
    return of(File.of(path), str(path))


def record(
    path: str | Path,
    *,
    joints: Mapping[str, Joints] | None = None,
    poses: Mapping[str, Trajectory] | None = None,
    pictures: Mapping[str, Pictures] | None = None,
) -> Stream:
    """Write a recording of topics and open it; pictures are generated and written one by one.

    Args:
        path: The `.mcap` file.
        joints: Topic -> `sensor_msgs/JointState`s.
        poses: Topic -> `geometry_msgs/PoseStamped`s in the parent frame.
        pictures: Topic -> `sensor_msgs/CompressedImage`s.
    """
    sources = [_joint_messages(topic, each) for topic, each in (joints or {}).items()]
    sources += [_pose_messages(topic, each) for topic, each in (poses or {}).items()]
    sources += [_picture_messages(topic, each) for topic, each in (pictures or {}).items()]
    with Path(path).open("wb") as out, Recording(out) as recording:
        for time, topic, kind, message in heapq.merge(*sources, key=lambda each: each[0]):
            recording.send(topic, kind, time, message)
    return load(path)


def joints(stream: Stream, topic: str, start: float | None = None, end: float | None = None) -> Joints:
    """Joint states of a topic with start <= time of the recording [s] < end; stamps are those of the headers.

    Raises:
        ArtifactError: There is no such topic, or its joints change.
    """
    rows = [(reading.stamp(each, time), each) for time, each in _read(stream, topic, JOINTS, start, end)]
    names = {tuple(each.name) for _, each in rows}
    if len(names) > 1:
        first, second = sorted(names)[:2]
        raise ArtifactError(
            f"the joints of `{topic}` change during the recording",
            code="DXB-A519",
            facts={"once": listing(first), "then": listing(second)},
            hint="record every robot on a topic of its own, or choose a time range",
        )
    known = next(iter(names), ())
    positions = np.array([each.position for _, each in rows], np.float64).reshape(len(rows), len(known))
    return Joints(
        names=known,
        stamps=np.array([stamp / reading.SECOND for stamp, _ in rows], np.float64),
        positions=positions,
        velocities=_column([each.velocity for _, each in rows], len(known)),
        efforts=_column([each.effort for _, each in rows], len(known)),
    )


def poses(stream: Stream, topic: str, child: str, start: float | None = None, end: float | None = None) -> Trajectory:
    """Stamped poses of a topic as the trajectory of the frame `child`, in the frame of their headers.

    Raises:
        ArtifactError: There is no such topic, or no message in the interval.
    """
    rows = [(reading.stamp(each, time), each) for time, each in _read(stream, topic, POSES, start, end)]
    placed = [(each.pose.position, each.pose.orientation) for _, each in rows]
    numbers = [[p.x, p.y, p.z, q.w, q.x, q.y, q.z] for p, q in placed]
    with reading.damage(topic):
        poses = unit(np.array(numbers, np.float64).reshape(-1, 7))
    stamps = np.array([stamp / reading.SECOND for stamp, _ in rows], np.float64)
    parent = rows[0][1].header.frame_id or "world" if rows else "world"
    return Trajectory(parent=parent, child=child, stamps=stamps, poses=poses)


def pictures(
    stream: Stream, topic: str, start: float | None = None, end: float | None = None
) -> Iterator[tuple[float, np.ndarray]]:
    """Pairs of a header's time [s] and pixels (H, W, 3) uint8 sRGB, read one by one.

    Raises:
        ArtifactError: There is no such topic, or a picture is damaged.
    """
    for time, each in _read(stream, topic, PICTURES, start, end):
        yield reading.stamp(each, time) / reading.SECOND, images.pixels(each, topic)


def depths(
    stream: Stream, topic: str, start: float | None = None, end: float | None = None, scale_m: float = images.MILLIMETRE
) -> Iterator[tuple[float, np.ndarray]]:
    """Pairs of a header's time [s] and depth (H, W) float32 [m], 0 if not measured, read one by one.

    Args:
        stream: The recording.
        topic: Topic of images of 16 bit counts or of metres.
        start: First time of the recording [s].
        end: End of the interval, exclusive [s].
        scale_m: Metres per count.

    Raises:
        ArtifactError: There is no such topic, or an image is damaged or no depth.
    """
    for time, each in _read(stream, topic, PICTURES, start, end):
        yield reading.stamp(each, time) / reading.SECOND, images.depths(each, topic, scale_m)


def stamps(stream: Stream, topic: str) -> np.ndarray:
    """(N, 2) times [s] of a topic's messages: of their headers, and of the recording.

    Raises:
        ArtifactError: There is no such topic.
    """
    kinds = JOINTS + POSES + PICTURES + LENSES
    rows = [[reading.stamp(each, time), time] for time, each in _read(stream, topic, kinds)]
    return np.array(rows, np.float64).reshape(-1, 2) / reading.SECOND


def lens(stream: Stream, topic: str) -> Lens:
    """The camera in the first message of a topic.

    Raises:
        ArtifactError: There is no such topic or no message, or its numbers are no valid camera.
    """
    for _, each in _read(stream, topic, LENSES):
        names = ("width", "height", "distortion_model", "d", "D", "k", "K")
        known = {name: _plain(getattr(each, name)) for name in names if hasattr(each, name)}
        known["distortion_model"] = _MODELS.get(known["distortion_model"], known["distortion_model"])
        try:
            return lens_files.of(camera_info.of(known))
        except ValueError as error:
            raise unreadable(topic, "a camera", error) from None
    raise unreadable(topic, "a camera", "it has no messages")


def transform(stream: Stream, topic: str) -> np.ndarray | None:
    """The first `geometry_msgs/Transform` of a topic as (4, 4) motion [m]; None if there is none."""
    if all(each.topic != topic or each.kind not in TRANSFORMS for each in stream.channels):
        return None
    for _, each in _read(stream, topic, TRANSFORMS):
        with reading.damage(topic):
            return _motion(each)
    return None


def _motion(transform: Any) -> np.ndarray:
    """(4, 4) of a `geometry_msgs/Transform` [m]."""
    place, turn = transform.translation, transform.rotation
    return matrices.to_matrix(unit(np.array([[place.x, place.y, place.z, turn.w, turn.x, turn.y, turn.z]]))[0])


def accelerations(stream: Stream, topic: str) -> np.ndarray:
    """(N, 4) time of the header [s] and acceleration [m/s^2] in the frame of the sensor of `sensor_msgs/Imu`s.

    Raises:
        ArtifactError: There is no such topic.
    """
    rows = [(reading.stamp(each, time), each.linear_acceleration) for time, each in _read(stream, topic, IMUS)]
    return np.array([[stamp / reading.SECOND, a.x, a.y, a.z] for stamp, a in rows], np.float64).reshape(-1, 4)


def frame(stream: Stream, topic: str) -> str:
    """The frame that the first picture or acceleration of a topic is in; "" if it has none.

    Raises:
        ArtifactError: There is no such topic.
    """
    return next((str(each.header.frame_id) for _, each in _read(stream, topic, PICTURES + IMUS)), "")


def frames(stream: Stream, topic: str) -> dict[tuple[str, str], np.ndarray]:
    """(parent, child) -> T_parent_child (4, 4) [m] of the `tf2_msgs/TFMessage`s of a topic, the first of each pair.

    Raises:
        ArtifactError: There is no such topic.
    """
    found: dict[tuple[str, str], np.ndarray] = {}
    for _, message in _read(stream, topic, FRAMES):
        for each in message.transforms:
            with reading.damage(topic):
                found.setdefault((each.header.frame_id, each.child_frame_id), _motion(each.transform))
    return found


def number(stream: Stream, topic: str) -> float | None:
    """The first `std_msgs/Float32` or `std_msgs/Float64` of a topic; None if there is none."""
    kinds = tuple(f"std_msgs/{middle}Float{bits}" for middle in ("msg/", "") for bits in (32, 64))
    if all(each.topic != topic or each.kind not in kinds for each in stream.channels):
        return None
    return next((float(each.data) for _, each in _read(stream, topic, kinds)), None)


def _read(
    stream: Stream, topic: str, kinds: tuple[str, ...], start: float | None = None, end: float | None = None
) -> Iterator[tuple[int, Any]]:
    found = next((each for each in stream.channels if each.topic == topic), None)
    if found is None or found.kind not in kinds:
        raise ArtifactError(
            f"there is no topic `{topic}` of {' or '.join(kinds)}",
            code="DXB-A520",
            facts={"topics": listing(f"{each.topic} ({each.kind})" for each in stream.channels)},
            hint="name a topic of that type",
        )
    limits = [None if time is None else max(0, round(time * reading.SECOND)) for time in (start, end)]
    with stream.file.open() as file:
        for time, _, message in reading.messages(file, topic, [topic], *limits):
            yield time, message


def save(stream: Stream, path: Path) -> list[Path]:
    """Write the file as it is."""
    stream.file.place(path)
    return [path]


Message = tuple[int, str, str, bytes]
"""Time [ns], topic, type, CDR bytes."""


def _joint_messages(topic: str, joints: Joints) -> Iterator[Message]:
    for row, stamp in enumerate(joints.stamps):
        time = round(float(stamp) * reading.SECOND)
        more = [() if each is None else each[row] for each in (joints.velocities, joints.efforts)]
        message = messages.joint_state(time, joints.names, joints.positions[row], *more)
        yield time, topic, "sensor_msgs/JointState", message


def _pose_messages(topic: str, path: Trajectory) -> Iterator[Message]:
    for stamp, pose in zip(path.stamps, path.poses, strict=True):
        time = round(float(stamp) * reading.SECOND)
        yield time, topic, "geometry_msgs/PoseStamped", messages.pose(time, path.parent, pose)


def _picture_messages(topic: str, pictures: Pictures) -> Iterator[Message]:
    for stamp, pixels in pictures.frames:
        time = round(stamp * reading.SECOND)
        data = packed(pixels, pictures.form)
        message = messages.compressed_image(time, pictures.frame, pictures.form, data)
        yield time, topic, "sensor_msgs/CompressedImage", message


def _plain(value: Any) -> Any:
    """Arrays of decoders as lists."""
    return value if isinstance(value, str | int) else [float(each) for each in value]


def _column(rows: list[Any], size: int) -> np.ndarray | None:
    """Rows (N, size), or None if a message lacks them."""
    if not rows or any(len(row) != size for row in rows) or not size:
        return None
    return np.array(rows, np.float64)

"""Bags as robots record them, written by `rosbags`: ROS 2 as SQLite and MCAP, ROS 1, RealSense."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.spatial.joints import Joints
from dextera_build.geometry import quaternions


class Bag:
    """Messages for a bag of ROS 1 (a name that ends in `.bag`) or ROS 2.

    Args:
        path: File or folder to write.
        sqlite: For ROS 2: SQLite instead of MCAP.
    """

    def __init__(self, path: Path, sqlite: bool = False) -> None:
        from rosbags.typesys import Stores, get_typestore

        self._path, self._sqlite, self._one = path, sqlite, path.suffix == ".bag"
        self._store = get_typestore(Stores.ROS1_NOETIC if self._one else Stores.ROS2_HUMBLE)
        self.packed: Any = None
        """Compression of the chunks of a bag of ROS 1."""
        self._messages: list[tuple[int, str, str, Any]] = []

    def joints(self, topic: str, joints: Joints) -> Bag:
        """Add joint states."""
        for stamp, row in zip(joints.stamps, joints.positions, strict=True):
            state = (self._header(stamp, ""), list(joints.names), row.copy(), np.zeros(0), np.zeros(0))
            self._add(topic, "sensor_msgs/msg/JointState", stamp, *state)
        return self

    def pictures(self, topic: str, frames: Mapping[float, np.ndarray], encoding: str = "rgb8") -> Bag:
        """Add images: stamp -> pixels (H, W, 3) uint8, or counts (H, W) uint16."""
        for stamp, each in frames.items():
            raw = np.ascontiguousarray(each).view(np.uint8).reshape(each.shape[0], -1)
            sizes = (*each.shape[:2], encoding, 0, raw.shape[1])
            self._add(topic, "sensor_msgs/msg/Image", stamp, self._header(stamp, "camera"), *sizes, raw.ravel())
        return self

    def lens(self, topic: str, camera: Camera, stamp: float) -> Bag:
        """Add a camera's intrinsics."""
        kind = self._store.types["sensor_msgs/msg/RegionOfInterest"]
        region = kind(0, 0, 0, 0, False)
        k = camera.matrix().ravel()
        p = np.hstack([camera.matrix(), np.zeros((3, 1))]).ravel()
        size = (camera.height, camera.width, "plumb_bob", np.zeros(5), k, np.eye(3).ravel(), p)
        self._add(topic, "sensor_msgs/msg/CameraInfo", stamp, self._header(stamp, "camera"), *size, 0, 0, region)
        return self

    def number(self, topic: str, value: float, stamp: float) -> Bag:
        """Add a `std_msgs/Float32`."""
        self._add(topic, "std_msgs/msg/Float32", stamp, value)
        return self

    def transform(self, topic: str, motion: np.ndarray, stamp: float) -> Bag:
        """Add a `geometry_msgs/Transform` of a (4, 4) motion."""
        made = self._motion(motion)
        self._add(topic, "geometry_msgs/msg/Transform", stamp, made.translation, made.rotation)
        return self

    def accelerations(self, topic: str, frame: str, rows: Mapping[float, np.ndarray]) -> Bag:
        """Add `sensor_msgs/Imu`s: stamp -> acceleration (3,) [m/s^2]."""
        types, unknown = self._store.types, np.array([-1.0, *np.zeros(8)])
        vector, turn = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
        for stamp, (x, y, z) in rows.items():
            fields = (turn(0.0, 0.0, 0.0, 1.0), unknown, vector(0.0, 0.0, 0.0), unknown, vector(x, y, z), unknown)
            self._add(topic, "sensor_msgs/msg/Imu", stamp, self._header(stamp, frame), *fields)
        return self

    def frames(self, topic: str, edges: Mapping[tuple[str, str], np.ndarray], stamp: float) -> Bag:
        """Add one `tf2_msgs/TFMessage`: (parent, child) -> T_parent_child (4, 4) [m]."""
        stamped = self._store.types["geometry_msgs/msg/TransformStamped"]
        rows = [stamped(self._header(stamp, one), other, self._motion(each)) for (one, other), each in edges.items()]
        self._add(topic, "tf2_msgs/msg/TFMessage", stamp, rows)
        return self

    def text(self, topic: str, value: str, stamp: float) -> Bag:
        """Add a `std_msgs/String`."""
        self._add(topic, "std_msgs/msg/String", stamp, value)
        return self

    def write(self) -> Path:
        """Write the bag."""
        with self._writer() as writer:
            known: dict[str, Any] = {}
            for time, topic, kind, message in sorted(self._messages, key=lambda each: each[0]):
                if topic not in known:
                    known[topic] = writer.add_connection(topic, kind, typestore=self._store)
                pack = self._store.serialize_ros1 if self._one else self._store.serialize_cdr
                writer.write(known[topic], time, pack(message, kind))
        return self._path

    def _writer(self) -> Any:
        from rosbags import rosbag1, rosbag2

        if self._one:
            writer = rosbag1.Writer(self._path)
            if self.packed:
                writer.set_compression(self.packed)
            return writer
        plugin = rosbag2.StoragePlugin.SQLITE3 if self._sqlite else rosbag2.StoragePlugin.MCAP
        return rosbag2.Writer(self._path, version=9, storage_plugin=plugin)

    def _motion(self, motion: np.ndarray) -> Any:
        types = self._store.types
        w, x, y, z = (float(each) for each in quaternions.from_matrix(motion[:3, :3]))
        place = types["geometry_msgs/msg/Vector3"](*(float(each) for each in motion[:3, 3]))
        return types["geometry_msgs/msg/Transform"](place, types["geometry_msgs/msg/Quaternion"](x, y, z, w))

    def _header(self, stamp: float, frame: str) -> Any:
        types, time = self._store.types, round(stamp * 1e9)
        when = types["builtin_interfaces/msg/Time"](time // 10**9, time % 10**9)
        header = types["std_msgs/msg/Header"]
        return header(len(self._messages), when, frame) if self._one else header(when, frame)

    def _add(self, topic: str, kind: str, stamp: float, *fields: Any) -> None:
        self._messages.append((round(stamp * 1e9), topic, kind, self._store.types[kind](*fields)))


def files(folder: Path) -> Iterator[tuple[str, bytes]]:
    """Name and bytes of a folder's files."""
    for path in sorted(folder.iterdir()):
        yield path.name, path.read_bytes()

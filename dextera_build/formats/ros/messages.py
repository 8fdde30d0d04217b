"""ROS 2 messages as CDR bytes. Stamps are nanoseconds; quaternions are x y z w."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.formats.ros.cdr import Cdr

SECOND = 1_000_000_000


def joint_state(
    stamp: int,
    names: Sequence[str],
    positions: np.ndarray,
    velocities: np.ndarray | tuple[()] = (),
    efforts: np.ndarray | tuple[()] = (),
) -> bytes:
    """`sensor_msgs/JointState` [rad or m]; speeds and efforts are empty if they were not recorded."""
    return _header(stamp, "").strings(names).f64s(positions).f64s(velocities).f64s(efforts).bytes()


def joint_trajectory(stamp: int, names: Sequence[str], positions: np.ndarray, reach: int) -> bytes:
    """`trajectory_msgs/JointTrajectory` with one point, to be reached after `reach` ns."""
    message = _header(stamp, "").strings(names).u32(1)
    return message.f64s(positions).f64s().f64s().f64s().i32(reach // SECOND).u32(reach % SECOND).bytes()


def transforms(stamp: int, edges: Sequence[tuple[str, str, np.ndarray]]) -> bytes:
    """`tf2_msgs/TFMessage` of edges (parent, child, pose (7,) of the child: position [m], quaternion w x y z)."""
    message = Cdr().u32(len(edges))
    for parent, child, placed in edges:
        _header(stamp, parent, message).string(child).f64(placed[:3]).f64(_xyzw(placed[3:]))
    return message.bytes()


def pose(stamp: int, frame: str, values: np.ndarray) -> bytes:
    """`geometry_msgs/PoseStamped` of a pose (7,), position [m] and quaternion w x y z."""
    return _header(stamp, frame).f64(values[:3]).f64(_xyzw(values[3:])).bytes()


def pose_array(stamp: int, frame: str, rows: np.ndarray) -> bytes:
    """`geometry_msgs/PoseArray` of poses (K, 7), position [m] and quaternion w x y z."""
    ordered = rows[:, [0, 1, 2, 4, 5, 6, 3]].astype(np.float64)
    return _header(stamp, frame).rows(ordered).bytes()


def joy(stamp: int, axes: np.ndarray, buttons: Sequence[int]) -> bytes:
    """`sensor_msgs/Joy` of analogue inputs (A,) and whole numbers."""
    message = _header(stamp, "").u32(len(axes)).f32(axes)
    return message.u32(len(buttons)).i32(*map(int, buttons)).bytes()


def text(words: str) -> bytes:
    """`std_msgs/String`."""
    return Cdr().string(words).bytes()


def numbers(names: Sequence[str], values: np.ndarray) -> bytes:
    """`std_msgs/Float64MultiArray` of named numbers; the label of its only dimension lists the names."""
    count = len(names)
    return Cdr().u32(1).string(", ".join(names)).u32(count, count, 0).f64s(values.ravel()).bytes()


def wrench(stamp: int, frame: str, force: np.ndarray) -> bytes:
    """`geometry_msgs/WrenchStamped` of a force (3,) [N] along the axes of `frame`; torque was not recorded."""
    return _header(stamp, frame).f64(force).f64((0.0, 0.0, 0.0)).bytes()


def compressed_image(stamp: int, frame: str, kind: str, data: bytes) -> bytes:
    """`sensor_msgs/CompressedImage`; `kind` is `png` or `jpeg`."""
    return _header(stamp, frame).string(kind).u8s(data).bytes()


def depth_image(stamp: int, frame: str, counts: np.ndarray) -> bytes:
    """`sensor_msgs/Image` of depth (H, W) uint16 in millimetres, `16UC1`; 0 where nothing was measured."""
    height, width = counts.shape
    message = _header(stamp, frame).u32(height, width).string("16UC1").boolean(False).u32(2 * width)
    return message.u8s(np.ascontiguousarray(counts, "<u2").tobytes()).bytes()


def compressed_video(stamp: int, frame: str, kind: str, data: bytes) -> bytes:
    """`foxglove_msgs/CompressedVideo` of one frame; `kind` is `h264`, in Annex B."""
    return Cdr().i32(stamp // SECOND).u32(stamp % SECOND).string(frame).u8s(data).string(kind).bytes()


def camera_info(stamp: int, frame: str, camera: Camera) -> bytes:
    """`sensor_msgs/CameraInfo` of a camera without distortion."""
    k = camera.matrix()
    projection = np.concatenate([k, np.zeros((3, 1))], axis=1)
    message = _header(stamp, frame).u32(camera.height, camera.width).string("plumb_bob").f64s(np.zeros(5))
    message.f64(k.ravel()).f64(np.eye(3).ravel()).f64(projection.ravel())
    return message.u32(0, 0).u32(0, 0, 0, 0).boolean(False).bytes()


def _header(stamp: int, frame: str, message: Cdr | None = None) -> Cdr:
    return (message or Cdr()).i32(stamp // SECOND).u32(stamp % SECOND).string(frame)


def _xyzw(quaternion: np.ndarray) -> np.ndarray:
    return np.roll(quaternion, -1)

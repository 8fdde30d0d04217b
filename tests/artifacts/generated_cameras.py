"""Random values of cameras and of what they see, whose fields depend on one another."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from hypothesis import strategies as st
from pydantic import BaseModel
from scipy.spatial.transform import Rotation

from dextera_build.artifacts.base import File
from dextera_build.artifacts.cameras.calibration import Board, Calibration
from dextera_build.artifacts.cameras.camera import Camera, Capture, Measured, Photograph
from dextera_build.artifacts.cameras.image import DepthImage, Image
from dextera_build.artifacts.cameras.lens import BrownConrady, Equirectangular, KannalaBrandt, Lens
from dextera_build.artifacts.cameras.mask_track import MaskTrack
from dextera_build.artifacts.cameras.panorama import Panorama
from dextera_build.artifacts.cameras.rgbd_video import RgbdVideo
from dextera_build.artifacts.cameras.rig import Rig
from dextera_build.artifacts.cameras.video import Video
from dextera_build.artifacts.cameras.views import Views, encoded
from dextera_build.artifacts.robots.hand_stream import HandStream
from dextera_build.artifacts.robots.robot_views import RobotViews
from dextera_build.artifacts.robots.stream import Channel, Stream
from dextera_build.artifacts.spatial.joints import Joints
from dextera_build.artifacts.spatial.point_cloud import PointCloud
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.artifacts.spatial.track import Track
from dextera_build.artifacts.spatial.tracking import Tracking
from dextera_build.artifacts.spatial.trajectory import Trajectory
from tests import hand_streams

Draw = Callable[[st.SearchStrategy[Any]], Any]
FRAMES = st.from_regex(r"[a-z][a-z0-9_]{0,7}", fullmatch=True)
SIZES = st.integers(1, 12)
LENGTHS = st.floats(1, 1e4)
COEFFICIENTS = st.floats(-1, 1)


def _size(draw: Draw) -> dict[str, Any]:
    return {"width": draw(SIZES), "height": draw(SIZES)}


def _lens(draw: Draw, *names: str) -> dict[str, Any]:
    base = {name: draw(LENGTHS) for name in ("fx", "fy", "cx", "cy")}
    return _size(draw) | base | {name: draw(COEFFICIENTS) for name in names}


def _brown_conrady(draw: Draw) -> dict[str, Any]:
    return _lens(draw, "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")


def _kannala_brandt(draw: Draw) -> dict[str, Any]:
    return _lens(draw, "k1", "k2", "k3", "k4")


def series(draw: Draw) -> dict[str, Any]:
    """Frames, increasing stamps, poses and covariances or None."""
    count = draw(st.integers(1, 5))
    random = np.random.default_rng(draw(st.integers(0, 1000)))
    poses = random.normal(size=(count, 7))
    poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    spread = random.normal(size=(count, 6, 6))
    return {
        "parent": draw(FRAMES),
        "child": draw(FRAMES),
        "stamps": np.cumsum(random.uniform(0.01, 1, count)),
        "poses": poses,
        "covariances": spread @ spread.transpose(0, 2, 1) if draw(st.booleans()) else None,
    }


def _track(draw: Draw) -> dict[str, Any]:
    fields = series(draw)
    kinds = st.sampled_from(["tracked", "predicted", "lost"])
    status = tuple(draw(kinds) for _ in fields["stamps"])
    fields["poses"][[word == "lost" for word in status]] = np.nan
    return fields | {"status": status}


def _poses(random: np.random.Generator, count: int) -> np.ndarray:
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = Rotation.random(count, rng=random).as_matrix()
    poses[:, :3, 3] = random.normal(size=(count, 3))
    return poses


def a_lens(draw: Draw) -> Lens:
    """Any lens; a small picture fits it."""
    kind = draw(st.sampled_from([Camera, BrownConrady, KannalaBrandt, Equirectangular]))
    return kind(**(_lens(draw) if kind is Camera else SPECIAL[kind](draw)))


def _views(draw: Draw) -> dict[str, Any]:
    cameras = {label: a_lens(draw) for label in draw(st.lists(FRAMES, min_size=1, max_size=2, unique=True))}
    names = tuple(f"{name}.png" for name in draw(st.lists(FRAMES, max_size=3, unique=True)))
    chosen = tuple(draw(st.sampled_from(sorted(cameras))) for _ in names)
    random = np.random.default_rng(draw(st.integers(0, 1000)))
    sizes = [(cameras[label].height, cameras[label].width, 3) for label in chosen]
    pixels = [random.integers(0, 256, size, dtype=np.uint8) for size in sizes]
    points = draw(
        st.none() | st.just(PointCloud(points=np.ones((2, 3), np.float32), colours=np.ones((2, 3), np.uint8)))
    )
    return {
        "images": {name: encoded(each) for name, each in zip(names, pixels, strict=True)},
        "names": names,
        "camera": chosen,
        "cameras": cameras,
        "poses": _poses(random, len(names)),
        "frame": draw(FRAMES),
        "points": points,
    }


def _panorama(draw: Draw) -> dict[str, Any]:
    random = np.random.default_rng(draw(st.integers(0, 1000)))
    height, width = draw(SIZES), draw(SIZES)
    place = Pose(parent=draw(FRAMES), child="camera", matrix=_poses(random, 1)[0])
    seen = draw(st.none() | st.just(random.integers(0, 2, (height, width)).astype(bool)))
    image = Image(pixels=random.integers(0, 256, (height, width, 3), dtype=np.uint8))
    return {"image": image, "pose": place, "seen": seen}


def _rig(draw: Draw) -> dict[str, Any]:
    labels = draw(st.lists(FRAMES, max_size=3, unique=True))
    matrices = _poses(np.random.default_rng(draw(st.integers(0, 1000))), len(labels))
    spread = draw(st.none() | st.just(np.diag([1e-6, 1e-6, 2e-6, 1e-8, 1e-8, 3e-8])))
    poses = {
        label: Pose(parent="rig", child=label, matrix=matrix, covariance=spread)
        for label, matrix in zip(labels, matrices, strict=True)
    }
    return {"cameras": {label: a_lens(draw) for label in labels}, "poses": poses}


def _calibration(draw: Draw) -> dict[str, Any]:
    random = np.random.default_rng(draw(st.integers(0, 1000)))
    in_hand, count = draw(st.booleans()), draw(st.integers(0, 4))
    holder, other = ("effector", "base") if in_hand else ("base", "effector")
    spread = random.normal(size=(6, 6))
    pose, board_pose = _poses(random, 2)
    covariance = spread @ spread.T if draw(st.booleans()) else None
    stamp = draw(st.none() | st.floats(0, 2e9))
    kinds = {
        "camera": st.none() | st.just(Camera(width=8, height=6, fx=7.0, fy=7.5, cx=3.25, cy=2.75)),
        "method": st.sampled_from(["", "Park"]),
        "board": st.none() | st.just(Board(kind="charuco", columns=9, rows=6, square_m=0.02, marker_m=0.015)),
        "board_pose": st.none() | st.just(Pose(parent=other, child="board", matrix=board_pose, covariance=covariance)),
        "residuals": st.none() | st.just(random.uniform(size=(count, 2))),
        "leave_one_out": st.none() | st.just(random.uniform(size=(count, 2))),
        "reprojection_px": st.none() | st.just(random.uniform(size=count)),
    }
    return {
        "mount": "eye_in_hand" if in_hand else "eye_on_base",
        "pose": Pose(parent=holder, child=draw(FRAMES), matrix=pose, covariance=covariance, stamp=stamp),
    } | {name: draw(kind) for name, kind in kinds.items()}


def _joints(draw: Draw) -> dict[str, Any]:
    names = tuple(draw(st.lists(FRAMES, min_size=1, max_size=3, unique=True)))
    random, count = np.random.default_rng(draw(st.integers(0, 1000))), draw(st.integers(0, 4))
    extra = st.none() | st.just(random.normal(size=(count, len(names))))
    return {
        "names": names,
        "stamps": np.cumsum(random.uniform(0.01, 1, count)),
        "positions": random.normal(size=(count, len(names))),
        "velocities": draw(extra),
        "efforts": draw(extra),
    }


def _robot_views(draw: Draw) -> dict[str, Any]:
    names = draw(st.lists(FRAMES, min_size=1, max_size=3, unique=True))
    random, count = np.random.default_rng(draw(st.integers(0, 1000))), len(names)
    camera = Camera(width=4, height=3, fx=7.0, fy=7.5, cx=1.25, cy=1.75)
    pixels = random.integers(0, 256, (3, 4, 3), dtype=np.uint8)
    measured = draw(st.none() | st.just(Measured(depth=DepthImage(depth=np.full((3, 4), 0.5, np.float32)))))
    capture = Capture(photograph=Photograph(rgb=Image(pixels=pixels), camera=camera), measured=measured)
    joints = Joints(names=("j1", "j2"), stamps=np.arange(float(count)), positions=random.normal(size=(count, 2)))
    poses = np.hstack([random.normal(size=(count, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))])
    known = draw(st.sampled_from([{"joints": joints}, {"effectors": poses}, {"joints": joints, "effectors": poses}]))
    return {
        "captures": dict.fromkeys(names, capture),
        "mount": draw(st.sampled_from(["eye_on_base", "eye_in_hand"])),
        "board": draw(st.none() | st.just(Board(kind="apriltag", square_m=0.048, dictionary="36h11"))),
        "skew_s": draw(st.none() | st.just(random.uniform(0, 0.02, count))),
    } | known


def _stream(draw: Draw) -> dict[str, Any]:
    channel = Channel(topic=draw(FRAMES), kind="std_msgs/msg/String", encoding="cdr", count=draw(SIZES))
    return {"file": File(data=draw(st.binary(max_size=9))), "channels": (channel,), "start_ns": 1, "end_ns": 2}


def _video(draw: Draw) -> dict[str, Any]:
    count = draw(st.integers(1, 5))
    is_key = np.array([True, *(draw(st.booleans()) for _ in range(count - 1))])
    file = File(data=draw(st.binary(max_size=9)))
    return _size(draw) | {"file": file, "stamps": 0.1 * np.arange(count), "is_key": is_key}


def _rgbd_video(draw: Draw) -> dict[str, Any]:
    count, size = draw(st.integers(1, 4)), _size(draw)
    random = np.random.default_rng(draw(st.integers(0, 1000)))
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = Rotation.random(count, random_state=random).as_matrix()
    poses[:, :3, 3] = random.normal(size=(count, 3))
    return {
        "file": File(data=draw(st.binary(max_size=9))),
        "camera": Camera(**size, **{name: draw(LENGTHS) for name in ("fx", "fy", "cx", "cy")}),
        "stamps": np.cumsum(random.uniform(0.01, 1, count)),
        "depth_scale_m": draw(st.floats(1e-4, 1e-2)),
        "poses": draw(st.none() | st.just(poses)),
        "frame": draw(FRAMES),
    }


def _tracking(draw: Draw) -> dict[str, Any]:
    first, joints = _track(draw), _joints(draw)
    names = draw(st.lists(FRAMES, min_size=1, max_size=3, unique=True))
    count = len(first["stamps"])
    columns = {"names": joints["names"], "stamps": first["stamps"]}
    held = Joints(**columns, positions=np.zeros((count, len(joints["names"]))))
    tracks = {name: Track(**first | {"child": name}) for name in names}
    return {"tracks": tracks, "joints": {names[0]: held} if draw(st.booleans()) else {}}


def _mask_track(draw: Draw) -> dict[str, Any]:
    names = tuple(draw(st.lists(FRAMES, min_size=1, max_size=3, unique=True)))
    random, count = np.random.default_rng(draw(st.integers(0, 1000))), draw(st.integers(1, 4))
    labels = random.integers(0, len(names) + 1, (count, draw(SIZES), draw(SIZES)), dtype=np.uint8)
    scores = random.random((count, len(names))) if draw(st.booleans()) else [None] * count
    made = MaskTrack.of(names, np.cumsum(random.uniform(0.01, 1, count)), zip(labels, scores, strict=True))
    return {name: getattr(made, name) for name in MaskTrack.model_fields}


def _hand_stream(draw: Draw) -> dict[str, Any]:
    count = draw(st.integers(1, 2))
    lost = [(draw(st.integers(0, 1)), 0, draw(st.integers(0, count)))]
    changes = {"head": None} if draw(st.booleans()) else {}
    return dict(hand_streams.stream(count, lost=lost, **changes))


SPECIAL: dict[type[BaseModel], Callable[[Draw], dict[str, Any]]] = {
    BrownConrady: _brown_conrady,
    KannalaBrandt: _kannala_brandt,
    Equirectangular: _size,
    Trajectory: series,
    Track: _track,
    Views: _views,
    Panorama: _panorama,
    Rig: _rig,
    Calibration: _calibration,
    HandStream: _hand_stream,
    Joints: _joints,
    RobotViews: _robot_views,
    Stream: _stream,
    Video: _video,
    MaskTrack: _mask_track,
    RgbdVideo: _rgbd_video,
    Tracking: _tracking,
}

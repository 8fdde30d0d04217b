"""Backend `opencv` of align.camera_motion: OpenCV's detectors of boards."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.cameras.calibration import Calibration
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.robots.robot_views import RobotViews
from dextera_build.geometry import hand_eye, hand_eye_refine
from dextera_build.rule import Backend, Context, Options

from . import detection, overlays, stated
from .sighting import Sighting

BACKEND = Backend(
    summary="OpenCV's detectors of ArUco, ChArUco, AprilTag and chessboards",
    profiles=("cpu",),
    packages=("opencv-python-headless", "mujoco"),
    extra="twin",
)
MOST_CORNER_PX = 3.0
"""Root mean square distance of corners from a flat board above which they are not those of the board [px]."""


def poses(
    ctx: Context,
    views: RobotViews,
    robot: RobotModel | None,
    calibration: Calibration,
    frame: str,
    options: Options,
) -> tuple[np.ndarray, np.ndarray]:
    """The poses of every picture in which the board is found."""
    from dextera_build.sim.model import forward

    board, board_pose = calibration.board or views.board, calibration.board_pose
    assert board_pose is not None
    if board is None:
        ctx.fail("neither capture nor calibration state the board", hint="describe it in the capture's `target`")
    effectors = stated.effectors(ctx, views, robot, frame, forward.frames)
    solution = hand_eye.Solution(calibration.pose.matrix, board_pose.matrix)
    expected, seen, tiles = [], [], []
    for (name, capture), effector in zip(views.captures.items(), effectors, strict=True):
        k = capture.photograph.camera.matrix()
        setup = hand_eye.Setup(k, views.mount == "eye_in_hand")
        picture = detection.look(capture.photograph.rgb.pixels, k, board, "edges")
        found = picture.sighting
        if found is None or found.rms_px > MOST_CORNER_PX:
            ctx.warn(f"`{name}` is left out: {picture.reason() if found is None else 'it shows another board'}")
            continue
        there = hand_eye.predicted(solution, hand_eye.View(name, effector, found.board, found.pixels, ()), setup)
        pixels, near = _nearest(found, there, k)
        view = hand_eye.View(name, effector, found.board, pixels, ())
        expected.append(there)
        seen.append(hand_eye_refine.alone(view, setup, near))
        tiles.append(overlays.drawn(capture.photograph.rgb.pixels, there, view.board, view.pixels, k, name))
    if not seen:
        ctx.fail("the board is in none of the pictures", hint="take a sharp picture with the whole board in view")
    ctx.preview(overlays.mosaic(tiles[: overlays.MOST]), "board as the calibration has it (green), and as seen (red)")
    return np.array(expected), np.array(seen)


def _nearest(found: Sighting, there: np.ndarray, k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Order of the pixels (J, 2), and the pose (4, 4) fitted to them, that is nearest to the expected pose.

    A marker that is seen nearly face on has two solutions; the local minimum near the expected pose is also tried.
    """
    fitting = []
    for order in (np.arange(len(found.pixels)), *found.orders):
        pixels = found.pixels[order]
        tried = detection.poses(found.board, pixels, k, found.marker is not None)
        view = hand_eye.View("", np.eye(4), found.board, pixels, ())
        near = hand_eye_refine.alone(view, hand_eye.Setup(k, False), there)
        off = hand_eye.offsets(hand_eye.Solution(np.eye(4), near), view, hand_eye.Setup(k, False))
        tried.append((near, float(np.sqrt((off**2).sum(axis=1).mean()))))
        fitting += [(pixels, pose, rms) for pose, rms in tried]
    best = min(rms for _, _, rms in fitting)
    pixels, pose, _ = min(
        (each for each in fitting if each[2] <= 2 * best + 0.5), key=lambda each: hand_eye.apart(there, each[1])
    )
    return pixels, pose

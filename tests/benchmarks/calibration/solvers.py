"""OpenCV's five hand-eye solvers beside `align.hand_eye` on real captures.

`python -m tests.benchmarks.calibration.solvers` prints the table.

Columns: standard deviation of the board's origin in the gripper (in the base for a camera in the hand) over the
pictures, as in the captures' README; and leave-one-out: with the calibration from all other pictures, how far
the board's corners are from where the left-out picture shows them, root mean square in space.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from dextera_build.artifacts.cameras.calibration import Board
from dextera_build.geometry import hand_eye, hand_eye_refine, poses, transforms
from dextera_build.geometry.hand_eye import Setup, Solution, View
from rules.align.calibration import detection
from tests.rules.align.calibration import test_real_captures as captures

METHODS = {
    "Tsai": cv2.CALIB_HAND_EYE_TSAI,
    "Park": cv2.CALIB_HAND_EYE_PARK,
    "Horaud": cv2.CALIB_HAND_EYE_HORAUD,
    "Andreff": cv2.CALIB_HAND_EYE_ANDREFF,
    "Daniilidis": cv2.CALIB_HAND_EYE_DANIILIDIS,
}
Solver = Callable[[list[View], Setup], Solution]


def opencv(method: int) -> Solver:
    """A solver on the poses of single pictures."""

    def solve(views: list[View], setup: Setup) -> Solution:
        robot = [transforms.invert(hand_eye.robot_side(view, setup)) for view in views]  # T_far_near
        seen = [view.candidates[0] for view in views]
        turn, place = cv2.calibrateHandEye(
            R_gripper2base=[each[:3, :3] for each in robot],
            t_gripper2base=[each[:3, 3] for each in robot],
            R_target2cam=[each[:3, :3] for each in seen],
            t_target2cam=[each[:3, 3] for each in seen],
            method=method,
        )
        x = transforms.rigid(turn, place.reshape(3))
        far = [transforms.invert(hand_eye.robot_side(v, setup)) @ x @ v.candidates[0] for v in views]
        return Solution(x, hand_eye.mean_pose(far))

    return solve


def ours(views: list[View], setup: Setup) -> Solution:
    """The joint refinement."""
    start, views = hand_eye.start(views, setup)
    return hand_eye_refine.refine(views, setup, start).solution


def spread(views: list[View], setup: Setup, solution: Solution) -> np.ndarray:
    """Standard deviation (3,) [mm] of the board's origin."""
    far = [transforms.invert(hand_eye.robot_side(view, setup)) @ solution.x @ view.candidates[0] for view in views]
    return 1000 * np.std([each[:3, 3] for each in far], axis=0)


def left_out(views: list[View], setup: Setup, solver: Solver) -> float:
    """Root mean square distance [mm] of the corners of each view from where all others put them."""
    off = []
    for number, view in enumerate(views):
        others = views[:number] + views[number + 1 :]
        there = hand_eye.predicted(solver(others, setup), view, setup)
        gap = transforms.apply(there, view.board) - transforms.apply(view.candidates[0], view.board)
        off.append((gap**2).sum(axis=1).mean())
    return 1000 * float(np.sqrt(np.mean(off)))


def settled(name: str, board: Board) -> tuple[list[View], Setup]:
    """Views whose ambiguities are solved the same way for all solvers."""
    capture = captures.views(name, board)
    views = []
    k = next(iter(capture.captures.values())).photograph.camera.matrix()
    setup = Setup(k, capture.mount == "eye_in_hand")
    for (label, each), row in zip(capture.captures.items(), capture.effectors, strict=True):
        seen = detection.look(each.photograph.rgb.pixels, k, board, "edges").sighting
        assert seen is not None
        views.append(View(label, poses.to_matrix(row), seen.board, seen.pixels, seen.candidates, seen.orders))
    start, views = hand_eye.start(views, setup)
    single = [hand_eye_refine.alone(view, setup, hand_eye.predicted(start, view, setup)) for view in views]
    return [View(v.name, v.effector, v.board, v.pixels, (pose,)) for v, pose in zip(views, single, strict=True)], setup


if __name__ == "__main__":
    if len(sys.argv) > 1:
        captures.CAPTURES = Path(sys.argv[1])
    print("| capture | solver | std of the board [mm] | leave-one-out [mm] |\n| --- | --- | --- | --- |")
    rows = (
        ("franka_eye_to_hand", "tag of 48 mm", captures.TAG),
        ("franka_eye_in_hand", "squares of 23.6 mm, as stated", captures.CHESS),
        ("franka_eye_in_hand", "squares of 26.2 mm", captures.LARGER),
    )
    for name, text, board in rows:
        views, setup = settled(name, board)
        for title, solver in {**{m: opencv(v) for m, v in METHODS.items()}, "align.hand_eye": ours}.items():
            x = solver(views, setup)
            std = " / ".join(f"{each:.1f}" for each in np.sort(spread(views, setup, x)))
            print(f"| {name}, {text} | {title} | {std} | {left_out(views, setup, solver):.2f} |", flush=True)

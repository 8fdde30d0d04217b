"""How often the truth lies in the stated 95 % region: `python -m tests.benchmarks.calibration.coverage [DRAWS]`."""

from __future__ import annotations

import sys

import numpy as np
from scipy.stats import chi2

from dextera_build.geometry import balanced_icp, boards, hand_eye, hand_eye_refine
from dextera_build.geometry.robot_covariance import Doubts
from tests.geometry import hand_eyes, toy_robots
from tests.geometry.hand_eyes import Errors, error_of
from tests.geometry.toy_robots import Faults

REGION = chi2.ppf(0.95, 6)
MARKER = boards.marker(0.05)


def of_hand_eye(draws: int, count: int, errors: Errors, *, in_hand: bool, marker: bool = False) -> str:
    """One row: fraction inside, and the median error."""
    far, off = [], []
    for seed in range(draws):
        board = MARKER if marker else None
        views, setup, truth = hand_eyes.simulate(
            seed, count, in_hand=in_hand, board=board, errors=errors, away=not marker
        )
        start, views = hand_eye.start(views, setup)
        found = hand_eye_refine.refine(views, setup, start)
        error = error_of(found.solution.x, truth.x)
        far.append(float(error @ np.linalg.solve(found.of_x, error)))
        off.append(1000 * float(np.linalg.norm(error[:3])))
    return _row(far, off)


def of_balanced(draws: int, count: int, faults: Faults) -> str:
    """One row: fraction inside, and the median error."""
    far, off = [], []
    for seed in range(draws):
        scene = toy_robots.capture(seed, count, faults=faults, size=0.3, hand_points=150)
        found = balanced_icp.correct(scene.poses, points=1500, doubts=Doubts(faults.joint_rad, faults.encoder_rad))
        error = error_of(found.motion, scene.error)
        far.append(float(error @ np.linalg.solve(found.covariance, error)))
        off.append(1000 * scene.hand_error(found.motion))
    return _row(far, off)


def _row(far: list[float], off: list[float]) -> str:
    return f"{np.mean(np.array(far) < REGION):.3f} | {np.median(off):.2f} mm |"


if __name__ == "__main__":
    draws = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    print(f"{draws} draws\n| quantity | setup | inside 95 % | median error |\n| --- | --- | --- | --- |")
    good, rough = Errors(), Errors(0.3, 0.001, 0.0005)
    print("| T_base_camera | chessboard, 10 views |", of_hand_eye(draws, 10, good, in_hand=False), flush=True)
    print("| T_effector_camera | chessboard, 8 views |", of_hand_eye(draws, 8, good, in_hand=True), flush=True)
    print("| T_base_camera | one marker of 5 cm, 12 views |", of_hand_eye(draws, 12, good, in_hand=False, marker=True))
    print(
        "| T_base_camera | chessboard, 20 views, 1 mm arm |", of_hand_eye(draws, 20, rough, in_hand=False), flush=True
    )
    both, offsets = Faults(joint_rad=0.001, encoder_rad=0.001), Faults(joint_rad=0.002)
    print("| dT of balanced ICP | 5 poses, joints 1 + 1 mrad |", of_balanced(draws, 5, both), flush=True)
    print("| dT of balanced ICP | 8 poses, zeros 2 mrad |", of_balanced(draws, 8, offsets), flush=True)
    print("| dT of balanced ICP | 5 poses, exact joints |", of_balanced(draws, 5, Faults()), flush=True)

"""Print what `align.hand_eye` says of mistakes in the poses of real captures.

    python -m tests.benchmarks.calibration.mistakes [MISTAKE ...]

Each of the poses of two captures of a Franka arm is changed as a common mistake would change it; the pictures stay as
they are. Names of mistakes restrict the table to them.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from dextera_build.artifacts.robots.robot_views import RobotViews
from dextera_build.errors import RuleError
from dextera_build.geometry import lie, poses, transforms
from dextera_build.testing import RuleRunner
from tests.rules.align.calibration.test_real_captures import LARGER, TAG, views

CAPTURES = {"franka_eye_to_hand": TAG, "franka_eye_in_hand": LARGER}


@dataclass(frozen=True)
class Mistake:
    """A mistake in the poses of a capture, and what is said of it."""

    planted: Callable[[np.ndarray], np.ndarray]
    """Poses (N, 7) of the effector in the base -> the wrong ones."""
    said: str
    """Part of the message."""
    other_side: bool = False
    """Whether the camera is stated on the other side instead."""


def _each(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[np.ndarray], np.ndarray]:
    """A change of every motion (4, 4), on rows (N, 7)."""
    return lambda rows: np.stack([poses.from_matrix(change(poses.to_matrix(row))) for row in rows])


def _turned(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[np.ndarray], np.ndarray]:
    """A change of every rotation (3, 3), on rows (N, 7)."""
    return _each(lambda motion: transforms.rigid(change(motion[:3, :3]), motion[:3, 3]))


MISTAKES = {
    "positions in millimetres": Mistake(lambda rows: rows * [1000, 1000, 1000, 1, 1, 1, 1], "look like millimetres"),
    "poses of the base in the effector": Mistake(
        _each(transforms.invert), "those of the base in the effector, or the camera is "
    ),
    "the camera on the other side": Mistake(
        lambda rows: rows, "those of the base in the effector, or the camera is ", other_side=True
    ),
    "quaternions x y z w": Mistake(lambda rows: rows[:, [0, 1, 2, 4, 5, 6, 3]], "in the order x y z w"),
    "each pose one picture late": Mistake(lambda rows: np.roll(rows, 1, axis=0), "the pose of one picture earlier"),
    "each pose one picture early": Mistake(lambda rows: np.roll(rows, -1, axis=0), "the pose of one picture later"),
    "rotation vectors in radians taken for degrees": Mistake(
        _turned(lambda turn: lie.rotation(np.radians(lie.rotation_vector(turn)))), "radians were read as degrees"
    ),
    "Euler angles xyz taken for rotation vectors": Mistake(
        _turned(lambda turn: lie.rotation(Rotation.from_matrix(turn).as_euler("xyz"))),
        "Euler angles about fixed axes xyz were read as rotation vectors",
    ),
    "rotation vectors taken for Euler angles xyz": Mistake(
        _turned(lambda turn: Rotation.from_euler("xyz", lie.rotation_vector(turn)).as_matrix()),
        "rotation vectors were read as Euler angles about fixed axes xyz",
    ),
}


def wrong(capture: str, name: str) -> RobotViews:
    """A capture with one mistake in its poses."""
    right, mistake = views(capture, CAPTURES[capture]), MISTAKES[name]
    assert right.effectors is not None
    mount = {"eye_in_hand": "eye_on_base", "eye_on_base": "eye_in_hand"}[right.mount]
    changed = {"effectors": mistake.planted(right.effectors), **({"mount": mount} if mistake.other_side else {})}
    return right.model_copy(update=changed)


def main(names: list[str]) -> None:
    """One row per mistake and capture."""
    print("| mistake | capture | what is said | corners before and after its correction [px] |\n|---|---|---|---|")
    for name in names or MISTAKES:
        for capture in CAPTURES:
            with tempfile.TemporaryDirectory() as folder:
                try:
                    found = RuleRunner(Path(folder)).run("align.hand_eye", views=wrong(capture, name))
                    said = f"accepted, {found.observations()} pictures"
                    facts = {}
                except RuleError as error:
                    said, facts = f"{error.message} ({error.hint})", error.facts
            print(f"| {name} | {capture} | {said} | {facts.get('then', facts)} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])

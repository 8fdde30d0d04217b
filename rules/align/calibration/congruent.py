"""Rotations of which each has several readings: those are chosen that turn between the pictures as the board does.

In X C_i = P_i Y, P_j P_i^-1 and C_j C_i^-1 are conjugate, so they turn by the same angle whatever X is (Chen 1991, "A
screw motion approach to uniqueness analysis of head-eye geometry").
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dextera_build.geometry import hand_eye, transforms
from dextera_build.geometry.hand_eye import Setup, View

ROUNDS = 5
"""Maximum number of times that every reading is chosen anew."""


def chosen(views: Sequence[View], setup: Setup, readings: Sequence[Sequence[np.ndarray]]) -> list[View]:
    """The views with the readings of their rotations that agree best with the board's rotations.

    Args:
        views: At least two.
        setup: Their shared properties.
        readings: For every view, possible rotations (3, 3) of T_base_effector; at least one.
    """
    turned = [
        [replace(view, effector=transforms.rigid(turn, view.effector[:3, 3])) for turn in turns]
        for view, turns in zip(views, readings, strict=True)
    ]
    # A pair of a reading and of a pose of the board, since one picture alone may permit two of these.
    pairs = [list(itertools.product(options, options[0].candidates)) for options in turned]
    robot = [np.stack([hand_eye.robot_side(view, setup)[:3, :3] for view, _ in each]) for each in pairs]
    board = [np.stack([seen[:3, :3] for _, seen in each]) for each in pairs]
    count = len(views)
    off = [
        [np.abs(_angles(robot[i], robot[j]) - _angles(board[i], board[j])) for j in range(count)] for i in range(count)
    ]
    best = min(_starts(off), key=lambda picks: _total(off, picks))
    return [pairs[i][pick][0] for i, pick in enumerate(best)]


def _angles(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Angles (A, B) between rotations (A, 3, 3) and (B, 3, 3) [rad]."""
    traces = np.einsum("aij,bij->ab", one, other)
    return np.asarray(np.arccos(np.clip((traces - 1) / 2, -1.0, 1.0)))


def _starts(off: list[list[np.ndarray]]) -> list[list[int]]:
    """Choices for every view that begin with each pair of choices of two neighbouring views."""
    found = []
    for first in range(len(off) - 1):
        one, other = off[first], off[first + 1]
        for a, b in itertools.product(range(len(one[first])), range(len(other[first + 1]))):
            picks = [int(np.argmin(one[k][a] + other[k][b])) for k in range(len(off))]
            picks[first], picks[first + 1] = a, b
            for _ in range(ROUNDS):
                again = [
                    int(np.argmin(sum(off[j][i][picks[j]] for j in range(len(off)) if j != i))) for i in range(len(off))
                ]
                if again == picks or _total(off, again) >= _total(off, picks):
                    break
                picks = again
            found.append(picks)
    return found


def _total(off: list[list[np.ndarray]], picks: list[int]) -> float:
    """Sum of the differences of all pairs of views [rad]."""
    return float(sum(off[i][j][picks[i], picks[j]] for i, j in itertools.combinations(range(len(off)), 2)))

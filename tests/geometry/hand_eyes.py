"""Simulated hand-eye captures without pictures: corners of a board with known errors of pixels and robot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import cameras, lie, transforms
from dextera_build.geometry.hand_eye import Setup, Solution, View

K = np.array([[607.6, 0.0, 323.5], [0.0, 607.6, 243.3], [0.0, 0.0, 1.0]])
MARKER = 0.5 * np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]])
"""Corners of a square marker of side 1 in OpenCV's order."""


def grid(columns: int = 6, rows: int = 4, step: float = 0.03) -> np.ndarray:
    """Inner corners (N, 3) of a chessboard [m]."""
    return np.array([[step * i, step * j, 0.0] for j in range(rows) for i in range(columns)])


@dataclass(frozen=True)
class Errors:
    """Standard deviations of the simulated errors."""

    pixel: float = 0.2
    place_m: float = 0.0005
    turn_rad: float = 0.001


def simulate(
    seed: int,
    count: int = 10,
    *,
    in_hand: bool = False,
    board: np.ndarray | None = None,
    spread_deg: float = 30.0,
    errors: Errors | None = None,
    axes: tuple[float, float, float] = (1.0, 1.0, 1.0),
    k: np.ndarray = K,
    away: bool = True,
) -> tuple[list[View], Setup, Solution]:
    """Views of a board, with the truth.

    `axes` weighs how far the board turns about its own axes, `away` says whether its z points away from who sees it.
    """
    draw, errors = np.random.default_rng(seed), errors or Errors()
    board = grid() if board is None else board
    x = _frame(draw, 0.8 if not in_hand else 0.08)
    y = _frame(draw, 0.1 if not in_hand else 0.5)
    setup, views = Setup(k, in_hand), []
    middle, out = board.mean(axis=0), 0
    while len(views) < count:
        facing = lie.rotation(np.radians(spread_deg) * draw.normal(size=3) * axes)
        turn = facing if away else np.diag([1.0, -1.0, -1.0]) @ facing
        place = np.array([*draw.uniform(-0.12, 0.12, 2), draw.uniform(0.45, 0.8)])
        seen = transforms.rigid(turn, place - turn @ middle)  # T_camera_board
        near = x @ seen @ transforms.invert(y)  # P
        corners = transforms.apply(seen, board)
        pixels = cameras.project(corners, k)
        out += 1
        if out < 4000 and (
            abs(turn[2, 2]) < 0.35 or (turn[2, 2] > 0) != away or (pixels < 0).any() or (pixels > [639, 479]).any()
        ):
            continue
        effector = transforms.invert(near) if in_hand else near
        error = transforms.rigid(
            lie.rotation(errors.turn_rad * draw.normal(size=3)), errors.place_m * draw.normal(size=3)
        )
        pixels = pixels + errors.pixel * draw.normal(size=pixels.shape)
        views.append(View(f"view_{len(views)}", effector @ transforms.invert(error), board, pixels, (seen,)))
    return views, setup, Solution(x, y)


def _frame(draw: np.random.Generator, far: float) -> np.ndarray:
    return transforms.rigid(lie.rotation(draw.normal(size=3)), far * draw.normal(size=3) / np.sqrt(3))


def error_of(found: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """(6,) translation [m] and rotation vector [rad] in the parent frame."""
    turn = found[:3, :3] @ truth[:3, :3].T
    return np.concatenate([found[:3, 3] - truth[:3, 3], lie.rotation_vector(turn)])

"""The hand-eye problem X C_i = P_i Y: views of a board, closed-form solutions, and observability by the robot's motion.

For a camera next to the robot X is T_base_camera, P_i is T_base_effector and Y is T_effector_board; for one on the hand
X is T_effector_camera, P_i is T_effector_base and Y is T_base_board. C_i is T_camera_board. The same code solves both,
and the robot's poses are inverted in one function, `robot_side`.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import lie, transforms

TRIPLES = 24
"""Number of triples of views that give initial solutions."""
OUTLIER_PX = 20.0
"""Residuals are clipped at this value when an initial solution is chosen [px]."""


@dataclass(frozen=True)
class View:
    """One picture of the board and the robot's pose in it."""

    name: str
    effector: np.ndarray  # (4, 4) T_base_effector [m]
    board: np.ndarray  # (J, 3) corners in the board's frame [m]
    pixels: np.ndarray  # (J, 2) their pixels, without lens distortion [px]
    candidates: tuple[np.ndarray, ...]  # (4, 4) T_camera_board each: candidates from one picture alone, best first
    orders: tuple[np.ndarray, ...] = ()  # (J,) each: other orders of `pixels` that the pattern permits


@dataclass(frozen=True)
class Setup:
    """Properties shared by all views."""

    k: np.ndarray  # (3, 3) pinhole intrinsics [px]
    in_hand: bool  # the camera is on the effector


@dataclass(frozen=True)
class Solution:
    """The two unknowns."""

    x: np.ndarray  # (4, 4) T_base_camera, or T_effector_camera on the hand
    y: np.ndarray  # (4, 4) T_effector_board, or T_base_board with a camera on the hand


def robot_side(view: View, setup: Setup) -> np.ndarray:
    """P_i (4, 4): T_base_effector, or its inverse for a camera on the hand."""
    return transforms.invert(view.effector) if setup.in_hand else view.effector


def predicted(solution: Solution, view: View, setup: Setup) -> np.ndarray:
    """T_camera_board (4, 4) = X^-1 P Y, predicted by the robot's pose."""
    return np.asarray(transforms.invert(solution.x) @ robot_side(view, setup) @ solution.y)


def turns(views: Sequence[View], setup: Setup) -> tuple[np.ndarray, np.ndarray]:
    """Rotation of the robot between the views, by axis.

    Returns:
        Singular values (3,), largest first [rad], and their axes (3, 3) as rows, in the effector's frame: root mean
        square of 2 sin(angle / 2) of all relative rotations. X is not determined if the second is 0.
    """
    rotations = np.stack([view.effector[:3, :3] for view in views])
    parts = []
    for first, second in itertools.combinations(rotations, 2):
        vector = lie.rotation_vector(first.T @ second)
        angle = float(np.linalg.norm(vector))
        parts.append(vector * (2 * np.sin(angle / 2) / angle if angle > 1e-12 else 1.0))
    if not parts:
        return np.zeros(3), np.eye(3)
    _, values, axes = np.linalg.svd(np.array(parts), full_matrices=False) if len(parts) >= 3 else _padded(parts)
    return values / np.sqrt(len(parts)), axes


def _padded(parts: list[np.ndarray]) -> tuple[None, np.ndarray, np.ndarray]:
    rows = np.vstack([*parts, *np.zeros((3 - len(parts), 3))])
    _, values, axes = np.linalg.svd(rows)
    return None, values, axes


def closed_form(robot: np.ndarray, seen: np.ndarray) -> Solution:
    """Initial solution from (K, 4, 4) P and C: Park and Martin (1994) for rotation, linear least squares otherwise.

    All pairs of views are used. Rotations about a single axis leave the solution undetermined, see `turns`.
    """
    first, second = np.array(list(itertools.combinations(range(len(robot)), 2))).T
    a = np.stack([robot[j] @ transforms.invert(robot[i]) for i, j in zip(first, second, strict=True)])
    b = np.stack([seen[j] @ transforms.invert(seen[i]) for i, j in zip(first, second, strict=True)])
    alpha = np.stack([lie.rotation_vector(each[:3, :3]) for each in a])
    beta = np.stack([lie.rotation_vector(each[:3, :3]) for each in b])
    # Near half a turn the sign of a rotation vector is arbitrary, so such pairs carry little information.
    sure = np.minimum(np.linalg.norm(alpha, axis=1), np.linalg.norm(beta, axis=1)) < np.radians(170.0)
    weight = np.where(sure, 1.0, 1e-3)
    u, _, vt = np.linalg.svd(np.einsum("n,ni,nj->ij", weight, alpha, beta))
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    left = (a[:, :3, :3] - np.eye(3)).reshape(-1, 3)
    right = (np.einsum("ij,nj->ni", turn, b[:, :3, 3]) - a[:, :3, 3]).reshape(-1)
    place = np.linalg.lstsq(left, right, rcond=None)[0]
    x = transforms.rigid(turn, place)
    return Solution(x, mean_pose([transforms.invert(p) @ x @ c for p, c in zip(robot, seen, strict=True)]))


def mean_pose(motions: Sequence[np.ndarray]) -> np.ndarray:
    """Mean (4, 4) of motions (4, 4): mean position and chordal mean rotation (Hartley et al. 2013)."""
    stack = np.stack(motions)
    u, _, vt = np.linalg.svd(stack[:, :3, :3].sum(axis=0))
    turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    return transforms.rigid(turn, stack[:, :3, 3].mean(axis=0))


def start(views: Sequence[View], setup: Setup, seed: int = 0) -> tuple[Solution, list[View]]:
    """The best closed-form solution of subsets of views and their candidates, judged by the corners of all views.

    A single square marker has two possible poses in one picture, a chessboard two orders of its corners; only one
    choice for each picture is consistent with the robot's motion.

    Args:
        views: At least three.
        setup: Their shared properties.
        seed: Seed of the sampling of triples, if there are many.

    Returns:
        The initial solution, and the views with the order of their corners resolved.
    """
    robot = np.stack([robot_side(view, setup) for view in views])
    best, cost = None, np.inf
    for chosen in _sets(len(views), seed):
        for picks in itertools.product(*(range(min(2, len(views[i].candidates))) for i in chosen)):
            seen = np.stack([views[i].candidates[pick] for i, pick in zip(chosen, picks, strict=True)])
            found = closed_form(robot[list(chosen)], seen)
            total = float(sum(_off(found, view, setup) for view in views))
            if total < cost:
                best, cost = found, total
    if best is None:
        raise ValueError("fewer than three views")
    for _ in range(3):  # all views together, each with its most consistent candidate
        nearest = [_nearest(view, predicted(best, view, setup)) for view in views]
        good = [i for i, view in enumerate(views) if _off(best, view, setup) < 0.5]
        if len(good) < 3:
            break
        found = closed_form(robot[good], np.stack([nearest[i] for i in good]))
        total = float(sum(_off(found, view, setup) for view in views))
        if total >= cost:
            break
        best, cost = found, total
    return best, [_settled(best, view, setup) for view in views]


def _nearest(view: View, pose: np.ndarray) -> np.ndarray:
    return min(view.candidates, key=lambda candidate: apart(pose, candidate))


def _sets(count: int, seed: int) -> list[tuple[int, ...]]:
    every: list[tuple[int, ...]] = list(itertools.combinations(range(count), 3)) if count <= 12 else []
    if not every:
        draw = np.random.default_rng(seed)
        every = [tuple(sorted(draw.choice(count, 3, replace=False).tolist())) for _ in range(TRIPLES)]
    if len(every) > TRIPLES:
        picked = np.random.default_rng(seed).choice(len(every), TRIPLES, replace=False)
        every = [every[i] for i in sorted(picked.tolist())]
    return every


def offsets(solution: Solution, view: View, setup: Setup) -> np.ndarray:
    """(J, 2) detected minus predicted corners [px]; infinite behind the camera."""
    corners = transforms.apply(predicted(solution, view, setup), view.board)
    ahead = corners[:, 2:] > 1e-3
    places = corners[:, :2] / np.where(ahead, corners[:, 2:], 1.0)
    projected = places @ setup.k[:2, :2].T + setup.k[:2, 2]
    return np.where(ahead, view.pixels - projected, 1e6)


def _off(solution: Solution, view: View, setup: Setup) -> float:
    """Mean squared distance of the corners, clipped at 1 beyond `OUTLIER_PX`, for the best order."""
    return min(
        float(np.minimum((offsets(solution, each, setup) ** 2).sum(axis=1) / OUTLIER_PX**2, 1.0).mean())
        for each in ordered(view)
    )


def ordered(view: View) -> list[View]:
    """The view, and copies with every other order of its corners that the pattern permits."""
    others = [
        View(view.name, view.effector, view.board, view.pixels[order], view.candidates, view.orders)
        for order in view.orders
    ]
    return [view, *others]


def _settled(solution: Solution, view: View, setup: Setup) -> View:
    best = min(ordered(view), key=lambda each: float((offsets(solution, each, setup) ** 2).sum()))
    return View(view.name, view.effector, view.board, best.pixels, view.candidates)


def apart(one: np.ndarray, other: np.ndarray) -> float:
    """Distance of two motions (4, 4); a radian is equivalent to half a metre."""
    gap = transforms.invert(one) @ other
    return float(np.linalg.norm(gap[:3, 3])) + 0.5 * transforms.angle(gap[:3, :3])

"""Joint refinement of a hand-eye calibration: all corners of all views, and the robot's own errors as a variance.

The unknowns are X, Y (see `hand_eye`) and three standard deviations: of a corner [px], and of the robot's poses [m,
rad]. A view's corners share the error of the robot's pose; without it their weight would be far too large and the
covariance far too small.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import least_squares, lie, transforms, variances
from dextera_build.geometry.hand_eye import Setup, Solution, View, offsets, predicted, robot_side

PRIORS = variances.Priors(typical=np.array([0.3, 5e-4, 1e-3]), groups=np.array([1, 1, 1, 2, 2, 2]))
"""Priors of the standard deviations: a third of a pixel, half a millimetre and a milliradian, within a factor of
seven."""
ROUNDS = 12
LARGEST_STEP = 0.3
"""Maximum step, in metres and radians, within which corners are approximately linear."""


@dataclass(frozen=True)
class Refined:
    """A refined calibration."""

    solution: Solution
    covariance: np.ndarray  # (12, 12) of X and Y: translation [m], rotation vector [rad] in the parent frame, each
    sigmas: np.ndarray  # (3,) of a corner [px], of the robot's position [m] and rotation [rad] per axis

    @property
    def of_x(self) -> np.ndarray:
        """Covariance of X, (6, 6)."""
        return self.covariance[:6, :6]


def refine(views: Sequence[View], setup: Setup, start: Solution, sigmas: np.ndarray | None = None) -> Refined:
    """Least squares over all corners, weighted by variances that are estimated from the residuals.

    Args:
        views: At least three, with resolved orders of corners.
        setup: Their shared properties.
        start: See `hand_eye.start`.
        sigmas: (3,) initial values, see `Refined`.
    """

    def step(now: Solution, _: int) -> tuple[np.ndarray, Solution]:
        blocks = [block(view, setup, now) for view in views]
        found = variances.weighted(blocks, PRIORS, PRIORS.typical if sigmas is None else sigmas).step
        found = np.clip(found, -LARGEST_STEP, LARGEST_STEP)
        return found, moved(now, found)

    *_, now = least_squares.gauss_newton(start, step, range(ROUNDS), 1e-7)
    fit = variances.fit([block(view, setup, now) for view in views], PRIORS, sigmas)
    now = moved(now, fit.step)
    # The weights changed once; another step with the final ones reaches their optimum.
    fit = variances.fit([block(view, setup, now) for view in views], PRIORS, fit.sigmas)
    return Refined(moved(now, fit.step), _widened(fit.covariance, len(views)), fit.sigmas)


def _widened(covariance: np.ndarray, count: int) -> np.ndarray:
    """The covariance scaled so that a normal region accounts for estimated variances (F instead of chi square).

    Each of the robot's two variances is estimated from about half of the residual degrees of freedom.
    """
    from scipy.stats import chi2, f

    freedom = 3 * count - 6
    if freedom < 1:
        return covariance
    return np.asarray(covariance * (6 * f.ppf(0.95, 6, freedom) / chi2.ppf(0.95, 6)))


def by_joints(
    views: Sequence[View], setup: Setup, refined: Refined, drifts: Sequence[np.ndarray], sigma: float
) -> np.ndarray:
    """Covariance (12, 12) of X and Y due to zero offsets of the joints, each the same in all views.

    Such errors hardly affect the residuals: that of the first joint is a rotation of the base.

    Args:
        views: Views of the calibration.
        setup: Their shared properties.
        refined: The calibration.
        drifts: (6, Q) of each view: motion of the effector in its frame, translation and rotation, per joint's motion.
        sigma: Standard deviation of each joint's zero [rad or m].
    """
    normal, pull = np.zeros((12, 12)), np.zeros((12, drifts[0].shape[1]))
    for view, drift in zip(views, drifts, strict=True):
        one = block(view, setup, refined.solution)
        weight = np.linalg.inv(variances.block_covariance(one, PRIORS, refined.sigmas))
        normal += one.design.T @ weight @ one.design
        pull += one.design.T @ weight @ one.disturbance @ drift
    by = sigma * np.linalg.solve(normal, pull)
    return np.asarray(by @ by.T)


def moved(solution: Solution, step: np.ndarray) -> Solution:
    """The solution after a step (12,): translation and rotation vector of X, then of Y, in their parent frames."""
    return Solution(lie.retract(solution.x, step[:6]), lie.retract(solution.y, step[6:]))


def block(view: View, setup: Setup, solution: Solution, *, sized: bool = False) -> variances.Block:
    """A view's corners, linearised in X, Y and the robot's error, in a basis of the board's six degrees of freedom.

    Args:
        view: The view.
        setup: Properties shared by all views.
        solution: Point of linearisation.
        sized: Add the logarithm of the board's size as the thirteenth parameter.
    """
    parts, by_corner = _derivatives(view, setup, solution)
    rows = 2 * len(view.board)
    by_x, by_y, by_robot, by_size = (np.einsum("jab,jbc->jac", by_corner, each).reshape(rows, -1) for each in parts)
    basis, _ = np.linalg.qr(np.hstack([by_y, by_size]) if sized else by_y)
    error = offsets(solution, view, setup).reshape(rows)
    inside = basis.T @ error
    design = basis.T @ np.hstack([by_x, by_y, by_size] if sized else [by_x, by_y])
    outside = max(float(error @ error - inside @ inside), 0.0)
    return variances.Block(inside, design, basis.T @ by_robot, outside, rows - basis.shape[1])


def _derivatives(view: View, setup: Setup, solution: Solution) -> tuple[list[np.ndarray], np.ndarray]:
    """Derivatives (J, 3, .) of corners in the camera by X, Y, the robot and the size, and (J, 2, 3) of pixels."""
    turn, robot = solution.x[:3, :3].T, robot_side(view, setup)
    board = view.board @ solution.y[:3, :3].T  # about Y's origin, in Y's parent frame
    far = board + solution.y[:3, 3]  # in Y's parent frame
    near = transforms.apply(robot, far)  # in X's parent frame
    by_x = _motion(-turn, turn, near - solution.x[:3, 3])
    through = turn @ robot[:3, :3]
    by_y = _motion(through, -through, board)
    # The robot's error is one of its effector, in the effector's frame.
    by_robot = _motion(-turn, turn, near) if setup.in_hand else _motion(through, -through, far)
    by_size = (board @ through.T)[:, :, None]
    corners = transforms.apply(predicted(solution, view, setup), view.board)
    depth = np.maximum(corners[:, 2], 1e-3)
    by_corner = np.zeros((len(corners), 2, 3))
    by_corner[:, 0, 0], by_corner[:, 1, 1] = setup.k[0, 0] / depth, setup.k[1, 1] / depth
    by_corner[:, 0, 2] = -setup.k[0, 0] * corners[:, 0] / depth**2
    by_corner[:, 1, 2] = -setup.k[1, 1] * corners[:, 1] / depth**2
    return [by_x, by_y, by_robot, by_size], by_corner


def _motion(by_place: np.ndarray, before: np.ndarray, arms: np.ndarray) -> np.ndarray:
    """(J, 3, 6): constant (3, 3) by translation, and `before` times [arm]x by rotation."""
    rotations = before @ transforms.cross_matrix(arms)
    return np.concatenate([np.broadcast_to(by_place, rotations.shape), rotations], axis=2)


def closing(view: View, setup: Setup, solution: Solution) -> tuple[float, float]:
    """Closing error of the chain of poses at the board: translation [m] and rotation [rad].

    The board's pose in this picture is the least squares solution near the predicted one.
    """
    gap = transforms.invert(predicted(solution, view, setup)) @ alone(view, setup, predicted(solution, view, setup))
    return float(np.linalg.norm(gap[:3, 3])), transforms.angle(gap[:3, :3])


def alone(view: View, setup: Setup, near: np.ndarray) -> np.ndarray:
    """T_camera_board (4, 4) of one picture by least squares over its corners, from a pose (4, 4) near it."""
    own = View(view.name, np.eye(4), view.board, view.pixels, ())
    fixed = Setup(setup.k, in_hand=False)

    def step(now: Solution, _: int) -> tuple[np.ndarray, Solution]:
        part = block(own, fixed, now)
        found = np.linalg.lstsq(part.design[:, 6:], part.error, rcond=None)[0]
        return found, moved(now, np.concatenate([np.zeros(6), np.clip(found, -0.2, 0.2)]))

    *_, now = least_squares.gauss_newton(Solution(np.eye(4), near), step, range(15), 1e-8)
    return now.y

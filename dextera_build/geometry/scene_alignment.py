"""Eq. 1 of the paper: pose and scale of a generated scene G against a measured RGB-D picture, coarse to fine.

    L_scene(theta) = lambda_rgb |I(theta) - I^R|^2_Omega + lambda_ssim [1 - SSIM(I(theta), I^R)]
                   + lambda_pix / |M| sum_m |u_m(theta) - u_m^R|_1 / d_img + lambda_dep / |M| sum_m |z_m(theta) - z_m^R|

with theta = (T_G_C, s_G). It is minimised by the Levenberg-Marquardt method; a step is accepted only if the whole
objective, rendered again, decreases. Exposure is a nuisance parameter that is solved for between steps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from dextera_build.geometry import least_squares, photo_terms, scene_terms, surface_term
from dextera_build.geometry.least_squares import Local, Normal, Schedule
from dextera_build.geometry.photo_terms import Drawn, Exposure
from dextera_build.geometry.scene_pose import ScenePose
from dextera_build.geometry.scene_terms import Correspondences, Terms, Weights

Render = Callable[[np.ndarray, np.ndarray, tuple[int, int]], Drawn]
"""G from T_G_C (4, 4) in the unit of G, with intrinsics (3, 3), in a picture of (rows, columns)."""

STEPS = 10
"""Maximum number of steps on one level before its pixels are selected again."""
DONE = 1e-5
"""Relative decrease of the objective below which the search ends."""
STILL = 2e-5
"""Step size below which the search ends, too [units of shift, rad, logarithm of the scale]."""


@dataclass(frozen=True)
class Level:
    """The photograph at one size."""

    rgb: np.ndarray  # (H, W, 3) I^R, 0..1
    depth: np.ndarray  # (H, W) [m], 0 where it is invalid
    valid: np.ndarray  # (H, W) usable pixels: not of the robot or an object, not saturated, depth measured
    k: np.ndarray  # (3, 3) [px]


@dataclass(frozen=True)
class Solution:
    """Result of the search."""

    pose: ScenePose
    covariance: np.ndarray  # (7, 7) covariance of steps, see `ScenePose.moved`
    condition: float  # condition number of the curvature
    terms: Terms
    light: Exposure
    drawn: Drawn | None  # G at the last level
    omega: np.ndarray | None  # (H, W) pixels used there


def align_sparse(
    pose: ScenePose, matches: Correspondences, k: np.ndarray, size: tuple[int, int], weights: Weights, unit: float
) -> Solution:
    """The minimum of the sparse terms alone; arguments as in `scene_terms.sparse`."""

    def at(theta: ScenePose) -> tuple[Terms, None]:
        return scene_terms.sparse(theta, matches, k, size, weights, unit), None

    pose, (terms, _) = _descended(pose, at(pose), at, unit, 50)
    return Solution(pose, *_spread(terms), terms, photo_terms.SAME, None, None)


@dataclass(frozen=True)
class Problem:
    """Input of Eq. 1 apart from theta."""

    matches: Correspondences  # M, in pixels of the photograph at its own size
    k: np.ndarray  # (3, 3) intrinsics at that size [px]
    size: tuple[int, int]  # rows and columns at that size
    levels: list[Level]  # the photograph, coarse to fine
    render: Render  # renders G
    weights: Weights
    unit: float  # length of a unit of shift in G; the median depth makes 0.001 about a milliradian
    apart: float  # relative depth difference above which surfaces differ and pixels are ignored


def align(pose: ScenePose, given: Problem) -> Solution:
    """The minimum of all four terms near `pose`."""
    for level in given.levels:
        drawn = given.render(pose.scene_from_camera, level.k, level.depth.shape)
        for _ in range(2):  # Omega and the exposure depend on the pose, so they are recomputed after it has moved
            within = _near(drawn.depth * pose.scale, level.depth, given.apart)
            here = _Compared(given, level, level.valid & drawn.solid & within, drawn)
            pose, (terms, drawn) = _descended(pose, here.terms(pose, drawn), here.at, given.unit, STEPS)
    return Solution(pose, *_spread(terms), terms, here.light, drawn, here.omega)


class _Compared:
    """All four terms at one size, over a fixed set of pixels."""

    def __init__(self, given: Problem, level: Level, omega: np.ndarray, drawn: Drawn) -> None:
        self._given, self._level, self.omega = given, level, omega
        self.light = photo_terms.exposure(drawn, level.rgb, omega)

    def at(self, pose: ScenePose) -> tuple[Terms, Drawn]:
        """The terms, and G from there."""
        drawn = self._given.render(pose.scene_from_camera, self._level.k, self._level.depth.shape)
        return self.terms(pose, drawn)

    def terms(self, pose: ScenePose, drawn: Drawn) -> tuple[Terms, Drawn]:
        """The terms for an existing rendering of G from `pose`."""
        given, level, weights, unit = self._given, self._level, self._given.weights, self._given.unit
        found = scene_terms.sparse(pose, given.matches, given.k, given.size, weights, unit)
        found += surface_term.surface(drawn, pose.scale, level.depth, self.omega, level.k, weights, unit)
        found += photo_terms.photometric(drawn, level.rgb, self.omega, level.k, weights, unit, self.light)
        return found, drawn


def _near(made: np.ndarray, measured: np.ndarray, apart: float) -> np.ndarray:
    return np.asarray((measured > 0) & (np.abs(made - measured) < apart * measured))


Seen = TypeVar("Seen")


@dataclass(frozen=True)
class _Eq1(Generic[Seen]):
    """The objective, for steps in theta; `at` gives its terms, and the renderings for them."""

    at: Callable[[ScenePose], tuple[Terms, Seen]]
    unit: float

    def value(self, seen: tuple[Terms, Seen], before: tuple[Terms, Seen]) -> float:
        return seen[0].value

    def local(self, pose: ScenePose, seen: tuple[Terms, Seen]) -> Local:
        terms = seen[0]
        return Local(Normal(terms.step, -terms.gradient), np.maximum(np.diag(terms.step), 1e-12))

    def moved(self, pose: ScenePose, step: np.ndarray) -> ScenePose:
        return pose.moved(step, self.unit)


def _descended(
    pose: ScenePose,
    here: tuple[Terms, Seen],
    at: Callable[[ScenePose], tuple[Terms, Seen]],
    unit: float,
    steps: int,
) -> tuple[ScenePose, tuple[Terms, Seen]]:
    """Levenberg-Marquardt on the true objective; `here` is `at(pose)`."""
    schedule = Schedule(
        steps, gain=DONE, promise=DONE, still=STILL, damping=1e-3, easier=10, harder=10, least=1e-6, most=1e3
    )
    return least_squares.levenberg_marquardt(pose, here, _Eq1(at, unit), schedule)


def _spread(terms: Terms) -> tuple[np.ndarray, float]:
    """Covariance of steps (7, 7) and condition of the curvature.

    The gradient at the optimum is zero, so an error is the inverse curvature times the gradient due to noise. Gradients
    are correlated within a cell of the picture and independent between cells: a sandwich estimator over clusters
    (Huber, 1967), corrected for the influence of each cell on the estimate (CR3: Bell and McCaffrey, 2002), and scaled
    to the 95 % region of Hotelling's distribution for few cells. The noise is estimated from the residuals alone.
    """
    from scipy.special import chdtri, fdtri

    values, axes = np.linalg.eigh(terms.curvature)
    largest = max(float(values[-1]), 1e-300)
    condition = largest / max(float(values[0]), 1e-15 * largest)
    inverse = axes / np.maximum(values, 1e-12 * largest) @ axes.T
    used = (terms.cells != 0).any(axis=1)
    count, size = int(used.sum()), len(values)
    if count <= size:
        return np.full((size, size), np.nan), condition
    alone = np.eye(size) - terms.bends[used] @ inverse
    slopes = np.linalg.solve(alone, terms.cells[used][..., None])[..., 0]
    wider = size * (count - 1) / (count - size) * fdtri(size, count - size, 0.95) / chdtri(size, 0.05)
    return np.asarray(wider * inverse @ slopes.T @ slopes @ inverse), condition

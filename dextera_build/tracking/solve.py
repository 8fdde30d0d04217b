"""Gauss-Newton steps over all terms of one object, and their covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from dextera_build.geometry import least_squares, lie
from dextera_build.tracking import motions, outline, spread, terms
from dextera_build.tracking.colours import Colours
from dextera_build.tracking.frame import Frame
from dextera_build.tracking.model import Cast, Model, State

PRIOR = np.array([0.03, 0.03, 0.03, 0.03, 0.03, 0.03])
"""Standard deviation of a prediction [m, rad], added to terms with correlated errors: motions that no term determines
keep the prediction, such as the rotation of a round object about its axis."""
STANDING = np.full(6, 0.002)
"""The same for an object that stood and is partly hidden, so that the occluder does not rotate it [m, rad]."""
JOINT_PRIOR = 0.1
"""Standard deviation of a predicted joint position [rad or m]."""


@dataclass(frozen=True)
class Fit:
    """Result of a fit of one object in one frame."""

    state: State
    spread: spread.Spread
    middle_sigma_m: float  # largest standard deviation of the position of its centre along any axis [m]
    correlation: float  # of brightness with a stored view; NaN if there is none or no texture
    outline: float  # fraction of the outline at its expected position; NaN if none is visible
    sharp: float  # fraction of the outline that is detected there clearly; NaN if none is visible

    @property
    def covariance(self) -> np.ndarray:
        """(6 + J, 6 + J) of a twist and the joints [m, rad]."""
        return self.spread.covariance()


@dataclass(frozen=True)
class Stage:
    """One render of the model, and the steps made with it."""

    gates_m: tuple[float, ...]
    reach_px: int


COARSE = Stage((0.03, 0.02, 0.015), 14)
FINE = Stage((0.012, 0.010, 0.008), 7)
ALIKE = 0.2
"""Minimum correlation of brightness with a stored view at which its differences are used."""
CLEAR_PX = 3.0
"""Standard deviation of an outline's position below which it is detected; equal colours on both sides give 4.3 [px]."""
POINTS = 350
"""Number of points on a model that are compared with the depth."""


def fit(
    model: Model,
    frame: Frame,
    start: State,
    colours: Colours,
    look: terms.Look | None,
    stages: Sequence[Stage] = (COARSE, FINE),
    number: int = 0,
    prior: np.ndarray = PRIOR,
) -> Fit | None:
    """Refine a state; None if the model is outside the picture, or too little of it is inside.

    Args:
        model: The object.
        frame: The current frame.
        start: The prediction, to which undetermined motions are pulled.
        colours: Colour model of the object and its surroundings.
        look: A stored view of its texture.
        stages: Coarse to fine.
        number: Number of the object, as in `Frame.owner`.
        prior: Standard deviation of the prediction (6,) [m, rad].
    """
    fitting = _Fitting(model, frame, start, colours, look, number, prior)
    now = _Now(start)
    for stage in stages:
        shown = _Shown.of(model, frame, now.state, stage.reach_px)
        if shown is None:
            return None
        *_, now = least_squares.gauss_newton(now, partial(fitting.step, shown), stage.gates_m)
    errors = spread.of(now.rows, now.earlier)
    state = State(motions.proper(now.state.pose), now.state.joints)
    return Fit(state, errors, _of_middle(model, state, errors.covariance()), now.score, *_placed_well(now.seen))


@dataclass(frozen=True)
class _Now:
    """A state, and the normal equations of the step to it."""

    state: State
    rows: Sequence[terms.Rows] = ()
    earlier: np.ndarray | None = None  # see `spread.of`
    score: float = np.nan  # see `Fit.correlation`
    seen: outline.Seen | None = None


@dataclass(frozen=True)
class _Shown:
    """One render of the model."""

    cast: Cast
    spots: terms.Spots
    edge: outline.Outline
    reach_px: int

    @classmethod
    def of(cls, model: Model, frame: Frame, state: State, reach_px: int) -> _Shown | None:
        """The render of a state; None if too little of it is inside the picture."""
        cast = model.cast(state, frame.k, frame.shape)
        if cast is None or cast.drawn.sum() < 20:
            return None
        return cls(cast, terms.Spots.of(cast, POINTS), outline.Outline.of(cast, frame.shape), reach_px)


@dataclass(frozen=True)
class _Fitting:
    """The least squares problem; see `fit`."""

    model: Model
    frame: Frame
    start: State
    colours: Colours
    look: terms.Look | None
    number: int
    prior: np.ndarray

    def step(self, shown: _Shown, now: _Now, gate: float) -> tuple[np.ndarray, _Now]:
        """One damped Gauss-Newton step."""
        model, frame, state, number = self.model, self.frame, now.state, self.number
        rows = [terms.depth(frame, terms.Placed.of(model, state, shown.spots), gate, number)]
        earlier, score, seen = None, now.score, now.seen
        if self.colours.known and len(shown.edge.outward):
            border = terms.Placed.of(model, state, shown.edge.spots)
            seen = outline.seek(frame, border, shown.edge, self.colours, shown.reach_px, number)
            rows.append(outline.rows(frame, border, shown.edge, seen))
        if self.look is not None:
            placed = terms.Placed.of(model, state, self.look.spots)
            found, score = terms.brightness(frame, placed, self.look, number, shown.cast)
            # If its appearance differs, gradients of a fine texture are misleading.
            if score > ALIKE:
                rows.append(found)
                earlier = self.look.error(state.pose)
        change = self._solved(state, rows)
        after = State(lie.retract(state.pose, change[:6]), model.limited(state.joints + change[6:]))
        return change, _Now(after, rows, earlier, score, seen)

    def _solved(self, now: State, rows: Sequence[terms.Rows]) -> np.ndarray:
        away = np.append(lie.between(now.pose, self.start.pose), self.start.joints - now.joints)
        known = least_squares.prior(np.append(self.prior, np.full(len(now.joints), JOINT_PRIOR)), away)
        step = sum((least_squares.normal(each.jacobian, each.off, each.weight) for each in rows), known).solved()
        # A step beyond the gates is shortened: the next one has new correspondences.
        far, wide = float(np.linalg.norm(step[:3])), float(np.linalg.norm(step[3:6]))
        return step * min(1.0, 0.04 / max(far, 1e-12), 0.35 / max(wide, 1e-12))


def _of_middle(model: Model, state: State, covariance: np.ndarray) -> float:
    """See `Fit.middle_sigma_m`; the origin of the mesh may be far away, where a rotation makes it uncertain."""
    moves = lie.point_motions((state.pose[:3, :3] @ model.centre)[None])[0, :, :6]
    return float(np.sqrt(np.linalg.eigvalsh(moves @ covariance[:6, :6] @ moves.T)[-1]))


def _placed_well(seen: outline.Seen | None) -> tuple[float, float]:
    """Fractions of the outline that are within 4 px, and that are detected clearly."""
    if seen is None or np.isfinite(seen.offset).sum() < 8:
        return np.nan, np.nan
    known = np.isfinite(seen.offset)
    near = np.abs(seen.offset[known]) < 4.0
    return float(near.mean()), float((near & (seen.sigma[known] < CLEAR_PX)).mean())

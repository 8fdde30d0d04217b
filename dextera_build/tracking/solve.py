"""Gauss-Newton steps over all terms of one object, and their covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dextera_build.tracking import motions, outline, spread, terms
from dextera_build.tracking.colours import Colours
from dextera_build.tracking.frame import Frame
from dextera_build.tracking.model import Model, State

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
        frame: What is seen.
        start: The prediction, to which undetermined motions are pulled.
        colours: Colour model of the object and its surroundings.
        look: A stored view of its texture.
        stages: Coarse to fine.
        number: Number of the object, as in `Frame.owner`.
        prior: Standard deviation of the prediction (6,) [m, rad].
    """
    now, score, seen = start, np.nan, None
    sigma = np.append(prior, np.full(len(model.joints), JOINT_PRIOR))
    rows: list[terms.Rows] = []
    earlier: np.ndarray | None = None
    for stage in stages:
        cast = model.cast(now, frame.k, frame.shape)
        if cast is None or cast.drawn.sum() < 20:
            return None
        spots = terms.Spots.of(cast, POINTS)
        edge = outline.Outline.of(cast, frame.shape)
        for gate in stage.gates_m:
            placed = terms.Placed.of(model, now, spots)
            rows, earlier = [terms.depth(frame, placed, gate, number)], None
            if colours.known and len(edge.outward):
                border = terms.Placed.of(model, now, edge.spots)
                seen = outline.seek(frame, border, edge, colours, stage.reach_px, number)
                rows.append(outline.rows(frame, border, edge, seen))
            if look is not None:
                found, score = terms.brightness(frame, terms.Placed.of(model, now, look.spots), look, number, cast)
                # If its appearance differs, gradients of a fine texture are misleading.
                if score > ALIKE:
                    rows.append(found)
                    earlier = look.error(now.pose)
            now = _step(model, now, start, rows, sigma)
    errors = spread.of(rows, earlier)
    state = State(motions.proper(now.pose), now.joints)
    return Fit(state, errors, _of_middle(model, state, errors.covariance()), score, *_placed_well(seen))


def _of_middle(model: Model, state: State, covariance: np.ndarray) -> float:
    """See `Fit.middle_sigma_m`; the origin of the mesh may be far away, where a rotation makes it uncertain."""
    x, y, z = state.pose[:3, :3] @ model.centre
    moves = np.hstack([np.eye(3), [[0, z, -y], [-z, 0, x], [y, -x, 0]]])
    return float(np.sqrt(np.linalg.eigvalsh(moves @ covariance[:6, :6] @ moves.T)[-1]))


def _placed_well(seen: outline.Seen | None) -> tuple[float, float]:
    """Fractions of the outline that are within 4 px, and that are detected clearly."""
    if seen is None or np.isfinite(seen.offset).sum() < 8:
        return np.nan, np.nan
    known = np.isfinite(seen.offset)
    near = np.abs(seen.offset[known]) < 4.0
    return float(near.mean()), float((near & (seen.sigma[known] < CLEAR_PX)).mean())


def _step(model: Model, now: State, start: State, rows: Sequence[terms.Rows], sigma: np.ndarray) -> State:
    """The state after one damped Gauss-Newton step."""
    normal, right = np.diag(sigma**-2.0), np.zeros(len(sigma))
    for each in rows:
        weighted = each.jacobian * each.weight[:, None]
        normal += weighted.T @ each.jacobian
        right += weighted.T @ each.off
    away = np.append(motions.between(now.pose, start.pose), start.joints - now.joints)
    right += away / sigma**2
    step = np.linalg.solve(normal, right)
    # A step beyond the gates is shortened: the next one has new correspondences.
    far, wide = float(np.linalg.norm(step[:3])), float(np.linalg.norm(step[3:6]))
    step *= min(1.0, 0.04 / max(far, 1e-12), 0.35 / max(wide, 1e-12))
    return State(motions.moved(now.pose, step[:6]), model.limited(now.joints + step[6:]))

"""Acceptance limits of a scene alignment, chosen on pairs of views that no table reports."""

from __future__ import annotations

import numpy as np
from pydantic import Field, PositiveFloat, PositiveInt

from dextera_build.artifacts.scenes.scene_fit import SceneEvidence
from dextera_build.artifacts.spatial.pose import Similarity
from dextera_build.rule import Fraction, Options


class Limits(Options):
    """Acceptance limits of an alignment."""

    inliers: PositiveInt = 20
    """Minimum number of inlier pairs."""
    inlier_fraction: Fraction = 0.4
    """Minimum fraction of inlier pairs."""
    spread: Fraction = 0.25
    """Minimum fraction of the 12 cells of the photograph with inliers."""
    overlap: Fraction = 0.2
    """Minimum fraction of the measured pixels at which the scene is visible."""
    agreement: Fraction = 0.7
    """Minimum fraction of these with agreeing depth."""
    correlation: Fraction = 0.4
    """Minimum correlation of grey values."""
    spread_m: PositiveFloat = 0.012
    """Maximum standard deviation of the position [m]."""
    scale_fraction: float = Field(0.02, gt=0.0, le=1.0)
    """Maximum relative standard deviation of the scale."""


def doubts(found: SceneEvidence, motion: Similarity, limits: Limits) -> tuple[str, ...]:
    """Violated limits of an alignment, each with its value and its limit."""
    assert motion.covariance is not None
    spread = np.sqrt(np.maximum(np.diag(motion.covariance), 0.0))
    part = found.inliers / max(found.pairs, 1)
    place = float(np.linalg.norm(spread[:3]))
    said = {
        f"{found.inliers} pairs agree, {limits.inliers} are needed": found.inliers < limits.inliers,
        f"{part:.0%} of the pairs agree, {limits.inlier_fraction:.0%} are needed": part < limits.inlier_fraction,
        f"they lie in {found.spread:.0%} of the photograph, {limits.spread:.0%} is needed": found.spread
        < limits.spread,
        f"{found.overlap:.0%} of the measured pixels show the scene, {limits.overlap:.0%} are needed": found.overlap
        < limits.overlap,
        f"depths agree in {found.agreement:.0%} of these, {limits.agreement:.0%} are needed": found.agreement
        < limits.agreement,
        f"grey values correlate by {found.correlation:.2f}, {limits.correlation:.2f} is needed": found.correlation
        < limits.correlation,
        f"the place is known to {1000 * place:.0f} mm, {1000 * limits.spread_m:.0f} mm is needed": not place
        <= limits.spread_m,
        f"the scale is known to {spread[6]:.1%}, {limits.scale_fraction:.1%} is needed": not spread[6]
        <= limits.scale_fraction,
    }
    return tuple(text for text, holds in said.items() if holds)

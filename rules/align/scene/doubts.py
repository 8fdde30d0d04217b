"""When an alignment of a scene is not believed. The limits were chosen on pairs of views that no table reports."""

from __future__ import annotations

import numpy as np
from pydantic import Field, PositiveFloat, PositiveInt

from dextera_build.artifacts.pose import Similarity
from dextera_build.artifacts.scene_fit import SceneEvidence
from dextera_build.rule import Fraction, Options


class Limits(Options):
    """What an alignment needs in order to be believed."""

    inliers: PositiveInt = 20
    """Least number of pairs that agree."""
    inlier_fraction: Fraction = 0.4
    """Least part of the pairs that agree."""
    spread: Fraction = 0.25
    """Least part of the 12 cells of the photograph that they lie in."""
    overlap: Fraction = 0.2
    """Least part of the measured pixels that show the scene."""
    agreement: Fraction = 0.7
    """Least part of these whose depths agree."""
    correlation: Fraction = 0.4
    """Least correlation of grey values."""
    spread_m: PositiveFloat = 0.012
    """Largest standard deviation of the place [m]."""
    scale_fraction: float = Field(0.02, gt=0.0, le=1.0)
    """Largest standard deviation of the scale, relative."""


def doubts(found: SceneEvidence, motion: Similarity, limits: Limits) -> tuple[str, ...]:
    """What speaks against an alignment, each with its number and its limit."""
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

"""Options of the backends of background.compose that optimise Gaussians."""

from __future__ import annotations

from pydantic import Field, NonNegativeFloat, NonNegativeInt

from dextera_build.rule import Fraction, Options


class OptimiseOptions(Options):
    """Options of backends `warp` and `gsplat` of background.compose."""

    steps: int = Field(150, ge=1, le=100_000)
    """Number of optimiser steps, one view each."""
    most: int = Field(500_000, ge=1, le=10_000_000)
    """Maximum number of Gaussians; neighbouring points are merged down to this number."""
    degree: int = Field(0, ge=0, le=3)
    """Degree of the colours' spherical harmonics; 0 is view-independent."""
    ssim_share: Fraction = 0.2
    """Weight of 1 - SSIM in the loss of the colours; the rest is L1."""
    depth_weight: NonNegativeFloat = 0.1
    """Weight of the mean relative error of the depth, if points provide it."""
    mean_step: NonNegativeFloat = 0.02
    """Initial step size of the means, in median distances between neighbouring points."""
    anchor: NonNegativeFloat = 0.1
    """Weight that keeps Gaussians near their initial values; without it they fit the views better, but new views
    worse."""
    held_out: NonNegativeInt = 8
    """Interval of the views held out for evaluation, starting in the middle; 0 for none."""
    seed: NonNegativeInt = 0
    """Seed of the order of the views."""

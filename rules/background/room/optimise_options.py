"""Options of the backends of background.compose that optimise Gaussians."""

from __future__ import annotations

from pydantic import Field, NonNegativeFloat, NonNegativeInt

from dextera_build.rule import Fraction, Options


class OptimiseOptions(Options):
    """Options of backends `warp` and `gsplat` of background.compose."""

    steps: int = Field(150, ge=1, le=100_000)
    """Steps of the optimiser, one view each."""
    most: int = Field(500_000, ge=1, le=10_000_000)
    """Most Gaussians; of more points, neighbours are joined."""
    degree: int = Field(0, ge=0, le=3)
    """Degree of the colours' spherical harmonics; 0 is the same from all sides."""
    ssim_share: Fraction = 0.2
    """Share of 1 - SSIM in the loss of the colours, the rest is L1."""
    depth_weight: NonNegativeFloat = 0.1
    """Weight of the mean relative error of the depth, where points tell it."""
    mean_step: NonNegativeFloat = 0.02
    """Step width of the means at the beginning, in median distances between neighbouring points."""
    anchor: NonNegativeFloat = 0.1
    """Weight of what holds Gaussians where they began; without it they fit the views better and other places worse."""
    held_out: NonNegativeInt = 8
    """Every so many views, from the middle of them on, one is only looked at; 0 for none."""
    seed: NonNegativeInt = 0
    """Order of the views."""

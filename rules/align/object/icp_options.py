"""Options of backend icp of align.object."""

from __future__ import annotations

from pydantic import NonNegativeFloat, PositiveFloat, PositiveInt

from dextera_build.rule import Fraction, Options


class IcpOptions(Options):
    """Options of backend `icp` of align.object."""

    guess_iou: Fraction = 0.6
    """Mask IoU above which the body's own pose is refined; below it every orientation is tried."""
    guess_scale_sigma: PositiveFloat = 0.003
    """Relative standard deviation of the scale if the body's own pose is accepted, because it was measured in
    metres."""
    start_scale_sigma: PositiveFloat = 0.10
    """Relative standard deviation of the scale from extent ratios."""
    gain: NonNegativeFloat = 0.01
    """Minimum improvement of the render score for a refined pose to replace the guess."""
    search_gain: NonNegativeFloat = 0.1
    """Minimum improvement of the render score for a pose found from scratch to replace a poor initial pose."""
    rest_m: NonNegativeFloat = 0.02
    """Maximum distance from the support of the lowest point of a body that stands on it [m]."""
    iterations: PositiveInt = 15
    """Iterations of the last registration; steps by depth and outline follow."""
    finalists: PositiveInt = 10
    """Number of starts registered after all were ranked."""
    coarse_iterations: PositiveInt = 6
    """Iterations of the registration of each finalist."""
    enough_cost: PositiveFloat = 0.09
    """Cost of the render, in addition to that of depth noise, above which four times as many starts are tried."""
    sure_iou: Fraction = 0.75
    """Mask IoU below which a placement found from scratch is flagged as ambiguous."""

"""Options of backend flow of align.follow."""

from __future__ import annotations

from pydantic import PositiveFloat

from dextera_build.rule import Fraction, Options


class FlowOptions(Options):
    """Options of backend `flow` of align.follow."""

    consistent_fraction: Fraction = 0.3
    """Part of an object whose forward and backward flow must agree; with less it is lost."""
    area_fraction: Fraction = 0.02
    """An object that shows less than this part of its area in the first frame is lost."""
    colour_difference: PositiveFloat = 20.0
    """Mean difference to the colours in the first frame, at equal brightness, up to which a pixel shows the object,
    0..255. A pixel that showed it before and moves with it may differ twice as much."""
    motion_px: PositiveFloat = 0.7
    """Largest distance of the flow of a pixel from the motion of the object that it moves with [px]."""

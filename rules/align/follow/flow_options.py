"""Options of backend flow of align.follow."""

from __future__ import annotations

from pydantic import PositiveFloat

from dextera_build.rule import Fraction, Options


class FlowOptions(Options):
    """Options of backend `flow` of align.follow."""

    consistent_fraction: Fraction = 0.3
    """Minimum fraction of an object with consistent forward and backward flow; below it the object is lost."""
    area_fraction: Fraction = 0.02
    """Minimum visible area of an object, as a fraction of its area in the first frame; below it the object is lost."""
    colour_difference: PositiveFloat = 20.0
    """Maximum mean difference of a pixel of the object to the colours in the first frame, at equal brightness,
    0..255. Doubled for pixels that belonged to the object before and move with it."""
    motion_px: PositiveFloat = 0.7
    """Maximum difference between the flow of a pixel and the motion of the object that it belongs to [px]."""

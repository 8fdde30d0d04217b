"""Parameters of the simulated errors of an RGB-D camera."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, NonNegativeFloat, NonNegativeInt, PositiveFloat, PositiveInt

from dextera_build.artifacts.core.value import Value

Fraction = Annotated[float, Field(ge=0, le=1)]


class DepthNoise(Value):
    """Noise of the depth stream."""

    baseline_m: PositiveFloat = 0.05
    """Distance between the two infrared cameras [m]."""
    focal_px: PositiveFloat = 640.0
    """Focal length of the infrared cameras [px]."""
    subpixel_px: NonNegativeFloat = 0.05
    """Standard deviation of the disparity [px]."""
    correlation_px: PositiveInt = 3
    """Width of the matching window [px]."""
    edge_px: NonNegativeInt = 2
    """Half width of the band without depth along edges [px]."""
    edge_step: NonNegativeFloat = 0.02
    """Relative depth step of an edge."""
    edge_loss: Fraction = 0.9
    """Fraction of the pixels in that band that are lost."""
    smear: Fraction = 0.0
    """Fraction of the kept pixels in that band whose depth is between that of both sides."""
    dark_loss: Fraction = 0.0
    """Fraction of black surface that is lost in patches; it falls to 0 at a fifth of white."""
    shine_loss: Fraction = 0.0
    """Fraction of the highlights that is lost."""
    grazing_deg: float = Field(82.0, ge=0.0, le=90.0)
    """Angle between ray and normal beyond which depth is lost [deg]."""
    dropout: Fraction = 0.002
    """Fraction of all pixels lost at random."""
    patches: Fraction = 0.0
    """Fraction of all pixels lost in patches."""
    nearest_m: NonNegativeFloat = 0.2
    """Minimum measured depth [m]."""
    farthest_m: PositiveFloat = 6.0
    """Maximum measured depth [m]."""
    step_m: PositiveFloat = 0.001
    """Quantisation [m]."""


class ColourNoise(Value):
    """Noise of the colour stream."""

    sigma: NonNegativeFloat = 0.006
    """Standard deviation per channel at mid grey, 0..1; proportional to the square root of brightness."""
    vignetting: Fraction = 0.18
    """Loss of brightness in the corners, 0..1."""

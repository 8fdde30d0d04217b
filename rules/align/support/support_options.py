"""Options of align.support."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, NonNegativeFloat, NonNegativeInt, PositiveFloat, PositiveInt

from dextera_build.rule import Options

from .unmeasured import MarkerOptions


class SupportOptions(Options):
    """Options of align.support."""

    farthest_m: PositiveFloat = 4.0
    """Depth beyond this is ignored [m]."""
    warp_m: NonNegativeFloat = 0.002
    """Unevenness of the support, one standard deviation, in addition to the depth camera's noise [m]."""
    smallest_m2: NonNegativeFloat = 0.02
    """Minimum visible area of a support [m^2]."""
    surfaces: PositiveInt = 6
    """Number of candidate planes."""
    up: Literal["auto", "top", "right", "bottom", "left"] = "auto"
    """Side of the picture that is up; `auto` uses the top, unless the depth shows a support only in a rotated
    picture."""
    at_px: tuple[NonNegativeInt, NonNegativeInt] | None = None
    """Column and row of a pixel of the support, if another surface was taken for it [px]."""
    seed: NonNegativeInt = 0
    """Seed of the random sampling."""
    marker: MarkerOptions | None = None
    """A marker on the support, for photographs without depth."""
    base_above_m: float = 0.0
    """Height of the robot's base above the support [m], for photographs without depth."""
    pitch_deg: float | None = Field(None, gt=0.0, le=90.0)
    """Pitch of the camera below the horizontal, for photographs without depth, marker, robot and gravity [deg]; it is
    taken to be good to 4 deg. None: by upright lines in the picture, or 35, good to 10, if they do not tell it."""
    reach: PositiveFloat = 3.0
    """Extent of an unmeasured support, in heights of the camera above it."""

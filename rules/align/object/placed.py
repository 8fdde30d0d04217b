"""The result of a backend of align.object."""

from __future__ import annotations

from dataclasses import dataclass

from dextera_build.artifacts.objects.object import Placement


@dataclass(frozen=True)
class Placed:
    """A placement and the agreement of its render with the view."""

    placement: Placement
    iou: float
    """Mask intersection over union, without occluded pixels."""
    violation: float
    """Fraction of the rendered pixels in free space."""
    gap_m: float
    """Height of the lowest point above the support [m]."""

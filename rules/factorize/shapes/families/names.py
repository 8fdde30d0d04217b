"""The names of the families of bodies that `factorize.mesh` tries; light, so that the rule's options can name them."""

from __future__ import annotations

HYPOTHESES = (
    "box",
    "tilted_box",
    "cylinder",
    "lying_cylinder",
    "revolved",
    "revolved_hollow",
    "oval",
    "extruded",
    "panels",
    "mirrored",
)
"""Every family, in the order in which they are tried."""

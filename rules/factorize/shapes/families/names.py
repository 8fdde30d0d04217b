"""Names of the body families of `factorize.mesh`; imports nothing, for use in the rule's options."""

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
"""All families, in the order in which they are tried."""

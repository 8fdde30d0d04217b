"""Names of the body families of `factorize.mesh`; imports nothing, for use in the rule's options."""

from __future__ import annotations

COMPARTMENTS = "compartments"
"""Vessels with dividers; tried where `open_box` is, from the vessel that it finds."""
TURNED = ("revolved_hollow", "open_box")
"""Vessels that are also fitted lying and leaning."""
TURNED_PREFIX = "tilted_"
"""Prefix of the name of a vessel that does not stand upright."""
GENERAL = ("superquadric", "lying", *(TURNED_PREFIX + name for name in TURNED), "mirrored")
"""Slow families that describe almost any body roughly; tried only if the others explain too little."""
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
    "open_box",
    COMPARTMENTS,
    "legged",
    "prism",
    *GENERAL,
)
"""All families, in the order in which they are tried."""

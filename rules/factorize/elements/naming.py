"""Descriptive words for unnamed objects: colour, everyday word or shape class, material."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.objects.object import Element

from ..regions.heights import Relief
from ..regions.proposals import Proposal
from . import cuboids, round_forms
from .nouns import noun

HUES = (
    (20.0, "pink"),
    (50.0, "red"),
    (73.0, "orange"),
    (108.0, "yellow"),
    (165.0, "green"),
    (200.0, "teal"),
    (312.0, "blue"),
    (335.0, "purple"),
    (360.0, "pink"),
)
"""Upper bound of the hue angle in the a*b* plane [deg] and its word."""
MATERIALS = {"box": "cardboard", "bowl": "ceramic", "mug": "ceramic", "laptop": "electronics"}
INWARD, VESSEL, SOLID = 0.12, 0.2, 0.04
"""Fraction of the seen surface that faces the object's centre: above 0.2 for bowls and mugs, below 0.04 for solids."""
FLAT = 0.75
"""Fraction of the seen surface in flat faces above which a body is a box."""
BORDER_PX = 2
"""Width of the border of a mask in which depth is smeared [px]."""
SURE, UNSURE = 0.9, 0.5
"""Confidence of the material for a clearly recognised shape class, and for a shape at the boundary between two
classes."""
SHAPES = ("box", "cylinder", "bowl", "mug", "laptop", "object")


def colour_word(lab: np.ndarray) -> str:
    """The most frequent colour word of (N, 3) CIE Lab pixels."""
    light, chroma = lab[:, 0], np.hypot(lab[:, 1], lab[:, 2])
    hue = np.degrees(np.arctan2(lab[:, 2], lab[:, 1])) % 360.0
    index = np.searchsorted([end for end, _ in HUES], hue, side="right")
    words = np.array([word for _, word in HUES], dtype="<U8")[np.minimum(index, len(HUES) - 1)]
    words[(words == "orange") & (light < 50)] = "brown"
    words[(words == "red") & (light > 65)] = "pink"
    words[(words == "pink") & (light < 50)] = "red"
    plain = chroma < np.where(light > 70, 22.0, 10.0)
    words[plain] = np.where(light[plain] > 68, "white", np.where(light[plain] < 25, "black", "gray"))
    names, counts = np.unique(words, return_counts=True)
    return str(names[int(np.argmax(counts))])


def shape_class(proposal: Proposal, relief: Relief, eye: np.ndarray) -> str:
    """`box`, `cylinder`, `bowl`, `mug`, `laptop` or `object`, from the form of the surface seen from `eye` (3,)."""
    if proposal.hinged:
        return "laptop"
    if proposal.inward > INWARD:
        points = relief.points[proposal.mask & relief.valid]
        width = float(np.median(np.quantile(points[:, :2], 0.98, axis=0) - np.quantile(points[:, :2], 0.02, axis=0)))
        return "mug" if proposal.top_m > 0.75 * width else "bowl"
    if _flat(proposal) > FLAT and _square(proposal.facets):
        return "box"
    inner = _inner(proposal, relief)
    if cuboids.is_box(inner, eye) and round_forms.cylinder(inner, eye) is None:
        return "box"
    bent = sum(p.area_m2 for p in proposal.patches if p.bend > 0.08 and p.flatness_m > 0.003)
    return "cylinder" if bent > 0.15 * sum(p.area_m2 for p in proposal.patches) else "object"


def material_confidence(proposal: Proposal, shape: str) -> float:
    """Confidence of the material of `shape`; lower the closer the surface is to another shape class."""
    if shape not in MATERIALS:
        return UNSURE
    margin = 1.0
    if shape in ("bowl", "mug"):
        margin = (proposal.inward - INWARD) / (VESSEL - INWARD)
    elif shape == "box":
        margin = min((_flat(proposal) - FLAT) / (1.0 - FLAT), (INWARD - proposal.inward) / (INWARD - SOLID))
    return UNSURE + (SURE - UNSURE) * float(np.clip(margin, 0.0, 1.0))


def word(proposal: Proposal, relief: Relief, eye: np.ndarray, shape: str) -> str:
    """What the thing is called: an everyday word if its outline and size tell it, else its shape class."""
    if shape not in ("cylinder", "object") or proposal.static or proposal.cut:
        return shape
    points = relief.points[proposal.mask & relief.valid]
    return noun(points, _inner(proposal, relief), eye, bent=shape == "cylinder") or shape


def _inner(proposal: Proposal, relief: Relief) -> np.ndarray:
    """Seen points (N, 3) of a thing that are not at the border of its mask [m]."""
    from scipy import ndimage

    inner = ndimage.binary_erosion(proposal.mask, iterations=BORDER_PX) & relief.valid
    return np.asarray(relief.points[inner])


def _flat(proposal: Proposal) -> float:
    return float(sum(share for _, share in proposal.facets))


def _square(facets: tuple[tuple[np.ndarray, float], ...]) -> bool:
    normals = np.array([normal for normal, _ in facets])
    cosines = np.abs(normals @ normals.T)[np.triu_indices(len(normals), 1)]
    return bool((cosines < np.cos(np.radians(65))).all())


def elements(proposals: tuple[Proposal, ...], relief: Relief, lab: np.ndarray, eye: np.ndarray) -> tuple[Element, ...]:
    """One uniquely named element per proposal, in the same order; `eye` is the position (3,) of the camera [m]."""
    found: list[Element] = []
    taken: set[str] = set()
    for proposal in proposals:
        shape = shape_class(proposal, relief, eye)
        colour = colour_word(lab[proposal.mask])
        called = word(proposal, relief, eye, shape)
        base = "fixture" if proposal.static else f"{colour}_{called}"
        found.append(
            Element(
                name=unique(base, taken),
                category="room" if proposal.static else shape,
                phrase=f"{colour} {called}" if proposal.cut else base.replace("_", " "),
                body_type="articulated" if shape == "laptop" and not proposal.static else "rigid",
                interactive=not proposal.static,
                box=proposal.box,
                material=MATERIALS.get(shape, "plastic"),
                material_confidence=material_confidence(proposal, shape),
                cut=proposal.cut,
            )
        )
    return tuple(found)


def unique(base: str, taken: set[str]) -> str:
    """`base`, or `base_2`, ... if taken; adds the name to `taken`."""
    name, number = base, 1
    while name in taken:
        number += 1
        name = f"{base}_{number}"
    taken.add(name)
    return name

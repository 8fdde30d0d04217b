"""Everyday words for things that stand: from their outline, and from the sizes of things of a household."""

from __future__ import annotations

import math

import numpy as np

from .. import household
from . import round_forms

OUTLINES = {"can": "straight", "tin": "straight", "bottle": "necked", "drill": "waisted"}
"""Last word of a thing's name -> outline of such things."""
SLICES = 8
"""Number of levels at which the width of a thing is taken."""
FEWEST = 15
"""Fewest points of a level."""
ON_SUPPORT_M = 0.02
"""Height of the lowest seen points of a thing that stands on the support [m]."""
FLAT = 0.6
"""Smallest height of a can that is not round, over its width."""
SPREAD = 0.15
"""Standard deviation of the logarithms of diameter and length, in addition to the thing's own, within which round
things tell about one another."""
LIKELY, NOTHING = 0.4, 0.5
"""Smallest share of a word among round things of a size, and the weight of no such thing beside theirs."""
MOST_HIDDEN = 0.7
"""Largest logarithm of the length of a thing over what is seen of it."""
NECK, TALL = 0.65, 1.4
"""Largest width of the highest level of a bottle, over the median, and its smallest height over its width."""
WAIST = 0.6
"""Largest width of the waist, over those of the widest levels above and below it."""
ALIKE = 0.12
"""Largest difference of the logarithms of height and width from those of the thing that gives the word, in addition to
the standard deviation of the thing's own sizes."""


def noun(points: np.ndarray, inner: np.ndarray, eye: np.ndarray, *, bent: bool) -> str:
    """`can`, `tin`, `bottle` or `drill`; empty if the thing is none of them.

    Args:
        points: Seen points (N, 3) of the thing, z up from the support [m].
        inner: Those of them (M, 3) that are not at the border of its mask.
        eye: Position (3,) of the camera [m].
        bent: Whether the surface is bent as that of a cylinder is.
    """
    if len(points) < SLICES * FEWEST:
        return ""
    low, high = np.quantile(points[:, 2], [0.02, 0.995])
    widths, height = _widths(points, eye, low, high), float(high - low)
    outline = _outline(widths, height)
    if outline != "necked" and len(inner) >= SLICES * FEWEST:
        form = round_forms.cylinder(inner, eye)
        if form is not None:
            return _round(form, float(low), float(high))
        # Flat things with round corners are of many kinds.
        if bent and height > FLAT * np.nanmedian(widths) and round_forms.is_prism(inner, eye):
            outline = "straight"
    width = float(np.nanmax(widths) if outline == "waisted" else np.nanmedian(widths))
    return _of_size(outline, height, width) if outline else ""


def _round(form: round_forms.Cylinder, low: float, top: float) -> str:
    """`can` or `tin`, if most round things of a household of this diameter and length are; else nothing.

    What stands on the support is as long as its top is high. Of what stands higher, a nearer thing may hide the lower
    part, so that it is at least as long as what is seen.
    """
    stands = not form.lies and low < ON_SUPPORT_M
    length, words = top if stands else form.length_m, dict[str, float]()
    for thing in household.things():
        across, own = _round_sides(thing)
        if not own:
            continue
        sigma, longer = math.hypot(thing.sigma, SPREAD), math.log(own / length)
        if not stands and not form.lies and 0.0 < longer < MOST_HIDDEN:
            longer = 0.0
        z = math.hypot(math.log(form.diameter_m / across), longer) / sigma
        words[thing.word] = words.get(thing.word, 0.0) + math.exp(-0.5 * z * z) / sigma**2
    best = max(words, key=lambda word: words[word])
    return best if best in OUTLINES and words[best] > LIKELY * (sum(words.values()) + NOTHING) else ""


def _round_sides(thing: household.Thing) -> tuple[float, float]:
    """Diameter and length of a thing that is a cylinder [m]; zeros of any other."""
    long, broad, deep = thing.sides_m
    if thing.kind != "cylinder" or not (long == broad or broad == deep):
        return 0.0, 0.0
    return (broad, long) if broad == deep else (long, deep)


def _widths(points: np.ndarray, eye: np.ndarray, low: float, high: float) -> np.ndarray:
    """Extent (SLICES,) across the line of sight at each level from the lowest up [m]; NaN where few points are seen."""
    ahead = np.median(points[:, :2], axis=0) - eye[:2]
    across = points[:, :2] @ np.array([-ahead[1], ahead[0]]) / max(float(np.linalg.norm(ahead)), 1e-9)
    number = np.floor(SLICES * (points[:, 2] - low) / max(high - low, 1e-9))
    found = np.full(SLICES, np.nan)
    for i in range(SLICES):
        own = across[number == i]
        if len(own) >= FEWEST:
            found[i] = np.ptp(np.quantile(own, [0.03, 0.97]))
    return found


def _outline(widths: np.ndarray, height: float) -> str:
    """`necked`, `waisted` or nothing. The lowest level is smeared into the support, the highest is cut."""
    if np.isnan(widths).any():
        return ""
    inner, middle = widths[1:-1], float(np.median(widths))
    waist = int(np.argmin(inner)) + 1
    if widths[waist] < WAIST * min(widths[:waist].max(), widths[waist + 1 :].max()):
        return "waisted"
    necked = widths[-1] < NECK * middle and height > TALL * middle and inner[: SLICES // 2].min() > NECK * middle
    return "necked" if necked else ""


def _of_size(outline: str, height: float, width: float) -> str:
    """The word of the thing with this outline whose height and width, as it stands, are nearest; not of round cans."""
    best = (math.inf, "")
    for thing in household.things():
        if OUTLINES.get(thing.word) != outline or (outline == "straight" and _round_sides(thing)[1]):
            continue
        tall, broad, deep = thing.sides_m
        # It stands on any face; turned about the vertical, it shows one side or the other.
        for up, sides in ((tall, (deep, broad)), (broad, (deep, tall)), (deep, (broad, tall))):
            off = [math.log(height / up), math.log(width / float(np.clip(width, *sides)))]
            if max(abs(one) for one in off) < ALIKE + thing.sigma:
                best = min(best, (math.hypot(*off), thing.word))
    return best[1]

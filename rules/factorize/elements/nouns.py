"""Everyday words for things that stand: from their outline, and from the sizes of things of a household."""

from __future__ import annotations

import math

import numpy as np

from .. import household

OUTLINES = {"can": "straight", "tin": "straight", "bottle": "necked", "drill": "waisted"}
"""Last word of a thing's name -> outline of such things."""
SLICES = 8
"""Number of levels at which the width of a thing is taken."""
FEWEST = 15
"""Fewest points of a level."""
STRAIGHT = 0.15
"""Largest relative difference of the widths of the inner levels of a straight thing from their median."""
LID = 0.4
"""Smallest level part of the surface of a can, as a fraction of the part that its lid takes of its picture."""
NECK, TALL = 0.65, 1.4
"""Largest width of the highest level of a bottle, over the median, and its smallest height over its width."""
WAIST = 0.6
"""Largest width of the waist, over those of the widest levels above and below it."""
ALIKE = 0.12
"""Largest difference of the logarithms of height and width from those of the thing that gives the word, in addition to
the standard deviation of the thing's own sizes."""


def noun(points: np.ndarray, eye: np.ndarray, level: float, *, bent: bool) -> str:
    """`can`, `tin`, `bottle` or `drill`; empty if the thing is none of them.

    Args:
        points: Seen points (N, 3) of the thing, z up [m].
        eye: Position (3,) of the camera [m].
        level: Fraction of the seen surface that is level.
        bent: Whether the surface is bent as that of a cylinder is.
    """
    if len(points) < SLICES * FEWEST:
        return ""
    low, high = np.quantile(points[:, 2], [0.02, 0.995])
    widths, height = _widths(points, eye, low, high), float(high - low)
    outline = _outline(widths, height)
    width = float(np.nanmax(widths) if outline == "waisted" else np.nanmedian(widths))
    if outline == "straight":
        away = float(np.linalg.norm(eye[:2] - np.median(points[:, :2], axis=0)))
        lid = np.pi / 4 * width * max(float(eye[2] - high), 0.0) / max(away, 1e-9)
        if not bent or level < LID * lid / (lid + height):
            return ""
    return _of_size(outline, height, width) if outline else ""


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
    """`straight`, `necked`, `waisted` or nothing. The lowest level is smeared into the support, the highest is cut."""
    inner = widths[1:-1]
    if np.isnan(widths).any():
        return "straight" if _straight(inner[~np.isnan(inner)]) else ""
    middle = float(np.median(widths))
    waist = int(np.argmin(inner)) + 1
    if widths[waist] < WAIST * min(widths[:waist].max(), widths[waist + 1 :].max()):
        return "waisted"
    if widths[-1] < NECK * middle and height > TALL * middle and inner[: SLICES // 2].min() > NECK * middle:
        return "necked"
    return "straight" if _straight(inner) else ""


def _straight(widths: np.ndarray) -> bool:
    if len(widths) < SLICES // 2:
        return False
    middle = float(np.median(widths))
    return bool(np.abs(widths - middle).max() < STRAIGHT * middle)


def _of_size(outline: str, height: float, width: float) -> str:
    """The word of the thing with this outline whose height and width, as it stands, are nearest."""
    best = (math.inf, "")
    for thing in household.things():
        if OUTLINES.get(thing.word) != outline:
            continue
        tall, broad, deep = thing.sides_m
        # A can stands on its end; other things stand on any face. Turned about the vertical, they show one side or the
        # other.
        faces = [(tall, (deep, broad)), (broad, (deep, tall)), (deep, (broad, tall))]
        if outline == "straight":
            faces = faces[:1] if broad == deep else faces[2:]
        for up, sides in faces:
            off = [math.log(height / up), math.log(width / float(np.clip(width, *sides)))]
            if max(abs(one) for one in off) < ALIKE + thing.sigma:
                best = min(best, (math.hypot(*off), thing.word))
    return best[1]

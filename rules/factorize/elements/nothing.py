"""Diagnosis of a photograph with depth in which no object was found: the cause and a remedy."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dextera_build.artifacts.objects.object import Element
from dextera_build.geometry import planes, regions
from dextera_build.geometry.regions import box_of

from ..measured import Workspace
from ..regions.heights import relief
from ..regions.proposals import SMALLEST_M2

Cause = tuple[str, str]
"""A cause and its remedy."""
FRONTAL = 0.9
"""Cosine between the support's normal and the camera's axis above which the support may be a wall."""
FAR_M = 2.0
"""Height of a camera above the support above which the unit of the depth is in doubt [m]."""
NEAR_M = 0.2
"""Height of a camera above the support below which the unit of the depth is in doubt [m]."""
SPARSE = 0.6
"""Fraction of pixels with depth over the support below which the depth is too sparse."""
FEW = 30
"""At most this many raised pixels are noise."""


def causes(seen: Workspace, static: tuple[Element, ...]) -> Iterator[Cause]:
    """All possible causes, most specific first.

    Args:
        seen: Photograph, depth and support.
        static: Detected regions that are not objects.
    """
    heights = relief(seen)
    raised, outline = int((heights.raised & heights.over).sum()), seen.over_support()[0]
    yield from _unit(seen)
    cut = [element.name for element in static if element.box and _at_border(element.box, seen.depth.shape)]
    if cut:
        things = "the thing" if len(cut) == 1 else f"{len(cut)} things"
        yield (
            f"the border of the picture cuts {things} found there",
            "turn or move the camera so that every object is whole in the picture",
        )
    if abs(seen.world_from_camera[2, 2]) > FRONTAL:
        yield (
            "the support is seen frontally, as a wall is",
            "aim at the table from above; a camera straight above it must see more than 12 mm of height",
        )
    empty = outline & (seen.depth <= 0)
    hole = _largest(empty)
    if (outline & (seen.depth > 0)).sum() < SPARSE * outline.sum():
        share = (outline & (seen.depth > 0)).sum() / max(1, outline.sum())
        yield f"only {share:.0%} of the support has depth", "capture it from nearer, without sun and mirrors"
    elif hole is not None:
        yield (
            f"a region of the support has no depth, {hole}; an object there may be shiny, clear or black",
            "cover it with a matt spray or tape, or name it in a `scene.yaml` and choose backends that need no depth",
        )
    if raised < FEW:
        yield "nothing is higher than the noise above the support", "check that objects are on it"
    elif not static:
        yield (
            f"the support is empty, or things on it are smaller than {1e4 * SMALLEST_M2:.0f} cm² or 12 mm high",
            "put objects on it, or capture them from nearer",
        )
    yield "the raised regions are too large, hang, or are not separate objects", "look at the preview of `support`"


def _unit(seen: Workspace) -> Iterator[Cause]:
    """Depth that is noise, or whose unit differs from the one that the capture states."""
    found = planes.mostly_noise(seen.depth)
    if found is not None:
        noise, middle = found
        yield (
            f"the depth is noise: neighbouring pixels differ by {1000 * noise:.0f} mm at a median of {middle:.2f} m",
            "check that the depth image holds the camera's raw counts, in the right order of bytes",
        )
    height = float(seen.world_from_camera[2, 3])
    if height < NEAR_M:
        yield (
            f"the support is only {100 * height:.0f} cm below the camera",
            "check `depth_scale_m` in `capture.json`: it may be too small, e.g. by a factor of 10",
        )
    if height > FAR_M:
        yield (
            f"the support is {height:.1f} m below the camera, where noise hides lower things",
            "check `depth_scale_m` in `capture.json`, or capture the table from 0.4 to 1.5 m",
        )


def _largest(mask: np.ndarray) -> str | None:
    """The largest connected region as `box [left, top, right, bottom]`, if it covers at least 0.3 % of the picture."""
    labels, count = regions.label(mask)
    if not count:
        return None
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    best = int(sizes.argmax())
    if sizes[best] < 0.003 * mask.size:
        return None
    return f"box {list(box_of(labels == best))}"


def _at_border(box: tuple[int, int, int, int], shape: tuple[int, ...]) -> bool:
    return box[0] <= 2 or box[1] <= 2 or box[2] >= shape[1] - 2 or box[3] >= shape[0] - 2

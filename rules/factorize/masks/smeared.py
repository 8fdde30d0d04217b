"""Rejection of proposals that are no body: depth smeared between two surfaces, or too little depth."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dextera_build.artifacts.objects.view import Instance, Seen
from dextera_build.geometry import cameras

from ..shapes import evidence
from .specks import why_speck

SOLID = 0.8
"""Smallest fraction of the measured pixels inside a body with trusted depth. Depth cameras smear depth between two
surfaces, where few pixels agree with their neighbours: bodies had 0.83 to 1.0 in real and drawn captures, a smear
0.78."""
INSIDE_PX = 3
"""Distance from the outline, along which depth is never trusted, from which pixels are counted [px]. Nearer ones are a
third of a small body: bodies of 25 px had 0.63 to 0.86 one pixel inside."""
LEAST_INSIDE = 250
"""With fewer pixels inside, as in a strip, those nearer to the outline are counted too."""
GRAZING = 0.35
"""Median cosine between normals and line of sight below which a region is a smear; bodies had 0.45 to 0.98."""

COVERED = 0.8
"""Fraction of the pixels with depth below which a shape is uncertain; objects of real captures have 0.92 to 1.0."""


def why_no_body(instance: Instance) -> str:
    """Why an object cannot be reconstructed: `only 103 of its 216 pixels have trusted depth`; empty if it can."""
    if instance.measured is None:
        return ""
    seen = evidence.gather(Seen(instance.view, instance.measured).upright())
    pixels, trusted = int(seen.mask.sum()), int(seen.core.sum())
    if trusted < evidence.LEAST_POINTS or (_solid(seen) < SOLID and not _is_hidden(seen)):
        return f"only {trusted:,} of its {pixels:,} pixels have trusted depth"
    towards = seen.eye - seen.points
    cosine = (towards * seen.normals).sum(axis=1) / np.linalg.norm(towards, axis=1)
    if float(np.median(cosine)) < GRAZING:
        return "its depth follows the lines of sight, like depth smeared between two surfaces"
    return why_speck(Seen(instance.view, instance.measured))


def _solid(seen: evidence.Evidence) -> float:
    """Fraction of the measured pixels inside the outline with trusted depth."""
    from scipy import ndimage

    measured = (seen.depth > 0) & seen.known
    for distance in range(INSIDE_PX, 0, -1):
        inside = ndimage.binary_erosion(seen.mask, np.ones((3, 3), bool), iterations=distance) & measured
        if inside.sum() >= LEAST_INSIDE:
            break
    return float(seen.core[inside].mean()) if inside.any() else 0.0


def sparse(instance: Instance) -> str:
    """Warning about the depth of an object: `only 64% of it has depth`; empty if there is none."""
    if instance.measured is None:
        return ""
    share = float((instance.measured.depth.depth > 0)[instance.view.mask].mean())
    return "" if share >= COVERED else f"only {share:.0%} of it has depth, so its shape is uncertain"


def _is_hidden(seen: evidence.Evidence) -> bool:
    """Whether trusted depth is missing because of an occluder, or because nothing was measured at all."""
    lost = seen.mask & ~seen.core
    return bool((lost & (~seen.known | (seen.depth <= 0))).sum() > 0.5 * lost.sum())


SMALL_M, LARGE_M = 0.03, 0.45
"""Range of sizes of graspable objects [m]; if all objects are smaller or all are larger, the unit is in doubt."""


def odd_scale(sizes: Mapping[str, float]) -> str:
    """Warning about the sizes of all objects [m]; empty if there is none."""
    if max(sizes.values()) < SMALL_M:
        return f"every object is smaller than {1000 * max(sizes.values()):.0f} mm"
    if min(sizes.values()) > LARGE_M:
        return f"every object is larger than {1000 * min(sizes.values()):.0f} mm"
    return ""


def size(instance: Instance) -> float:
    """Largest extent of the seen points without the outermost 2 % [m]; 0 without depth."""
    if instance.measured is None:
        return 0.0
    depth, mask = instance.measured.depth.depth, instance.view.mask
    points = cameras.backproject(depth, instance.view.camera.matrix())[mask & (depth > 0)]
    return float(np.max(np.quantile(points, 0.99, axis=0) - np.quantile(points, 0.01, axis=0))) if len(points) else 0.0

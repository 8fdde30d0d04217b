"""Proposals that are no body: depth smeared between two surfaces, and too little depth to make anything of."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dextera_build.artifacts.view import Instance, Seen
from dextera_build.geometry import cameras

from ..shapes import evidence

SOLID = 0.76
"""Depth cameras smear the depth between two surfaces, where few pixels agree with their neighbours. Of the measured
pixels inside their outline, bodies had trusted depth on 0.81 to 0.99 in real captures and from 0.77 in drawn ones,
smears on 0.65 to 0.74. Along the outline, depth is trusted nowhere."""
GRAZING = 0.35
"""A smear lies along the line of sight: median cosine between it and the normals; bodies had 0.45 to 0.98."""

COVERED = 0.8
"""Objects of real captures have depth on 0.92 to 1.0 of their pixels."""


def why_no_body(instance: Instance) -> str:
    """Why nothing can be made of an object: `only 103 of its 216 pixels have trusted depth`; empty if it can."""
    if instance.measured is None:
        return ""
    seen = evidence.gather(Seen(instance.view, instance.measured).upright())
    pixels, trusted = int(seen.mask.sum()), int(seen.core.sum())
    if trusted < evidence.LEAST_POINTS or (_solid(seen) < SOLID and not _is_hidden(seen)):
        return f"only {trusted:,} of its {pixels:,} pixels have trusted depth"
    towards = seen.eye - seen.points
    cosine = (towards * seen.normals).sum(axis=1) / np.linalg.norm(towards, axis=1)
    if float(np.median(cosine)) < GRAZING:
        return "its depth lies along the lines of sight, as depth smeared between two surfaces does"
    return ""


def _solid(seen: evidence.Evidence) -> float:
    """Share of the measured pixels inside the outline whose depth is trusted."""
    from scipy import ndimage

    inside = ndimage.binary_erosion(seen.mask, np.ones((3, 3), bool)) & (seen.depth > 0) & seen.known
    return float(seen.core[inside].mean()) if inside.any() else 0.0


def sparse(instance: Instance) -> str:
    """What is doubtful about the depth of an object: `only 64% of it has depth`; empty if nothing is."""
    if instance.measured is None:
        return ""
    share = float((instance.measured.depth.depth > 0)[instance.view.mask].mean())
    return "" if share >= COVERED else f"only {share:.0%} of it has depth, so its shape is uncertain"


def _is_hidden(seen: evidence.Evidence) -> bool:
    """Whether the trust is missing because something stands in front, or because nothing was measured at all."""
    lost = seen.mask & ~seen.core
    return bool((lost & (~seen.known | (seen.depth <= 0))).sum() > 0.5 * lost.sum())


SMALL_M, LARGE_M = 0.03, 0.45
"""Things that hands take from tables; if all are smaller or all are larger, the unit is in doubt [m]."""


def odd_scale(sizes: Mapping[str, float]) -> str:
    """What is odd about the sizes of all objects [m]; empty if nothing is."""
    if max(sizes.values()) < SMALL_M:
        return f"every object is smaller than {1000 * max(sizes.values()):.0f} mm"
    if min(sizes.values()) > LARGE_M:
        return f"every object is larger than {1000 * min(sizes.values()):.0f} mm"
    return ""


def size(instance: Instance) -> float:
    """The largest extent of the seen points, without the outermost 2 % [m]; 0 without depth."""
    if instance.measured is None:
        return 0.0
    depth, mask = instance.measured.depth.depth, instance.view.mask
    points = cameras.backproject(depth, instance.view.camera.matrix())[mask & (depth > 0)]
    return float(np.max(np.quantile(points, 0.99, axis=0) - np.quantile(points, 0.01, axis=0))) if len(points) else 0.0

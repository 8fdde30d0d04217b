"""Score how well a body explains a view: silhouette overlap, depth, and observed empty space."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dextera_build.geometry import raycast
from dextera_build.geometry.solids import Solid

from .evidence import Evidence, step

BEST = 1.0
"""Score of a body of no complexity that explains everything."""
DEPTH_WEIGHT = 0.5
"""Cost of a wrong depth at every pixel, relative to an overlap of 1."""
WRONG = 6.0
"""Depth difference of a wrong depth, in standard deviations."""
FREE_WEIGHT = 0.5
"""Cost of a rendered surface entirely in observed empty space."""


@dataclass(frozen=True)
class Judgement:
    """Scores of one body."""

    score: float
    """Overlap minus depth error, empty space and complexity; higher is better."""
    mask_iou: float
    residual_m: float
    """Median absolute depth difference on common trusted pixels [m]."""
    free: float
    """Fraction of the rendered pixels in front of the measured surface."""


def judge(body: Solid, evidence: Evidence, complexity: float = 0.0) -> Judgement:
    """Render a closed surface in the world frame from every camera and compare it with the views.

    The score is the mean of those of all photographs; everything else is of the first one.
    """
    first = _of_one(body, evidence)
    marks = [first, *(_of_one(body, other) for other in evidence.others)]
    return replace(first, score=sum(mark.score for mark in marks) / len(marks) - complexity)


def _of_one(body: Solid, evidence: Evidence) -> Judgement:
    height, width = evidence.mask.shape
    surface = raycast.Surface(body.vertices, body.faces)
    shown = raycast.render([surface], evidence.k, evidence.world_from_camera, height, width)
    covered, mask = (shown.index >= 0) & evidence.known, evidence.mask & evidence.known
    either = np.count_nonzero(covered | mask)
    iou = np.count_nonzero(covered & mask) / either if either else 0.0
    common = covered & evidence.core
    difference = np.abs(shown.depth - evidence.depth)[common]
    residual = float(np.median(difference)) if common.any() else float("inf")
    # Every trusted pixel counts; an uncovered one counts as entirely wrong.
    error = np.minimum(difference / (WRONG * evidence.sigma[common]), 1.0).sum()
    trusted = int(np.count_nonzero(evidence.core & evidence.known))
    depth_error = (float(error) + trusted - np.count_nonzero(common)) / trusted if trusted else 0.0
    seen_behind = (evidence.depth > 0) & (shown.depth < evidence.depth - step(evidence.sigma))
    clear = np.where(mask, evidence.core, True)
    free = np.count_nonzero(covered & seen_behind & clear) / max(int(np.count_nonzero(covered)), 1)
    score = iou - DEPTH_WEIGHT * depth_error - FREE_WEIGHT * free
    return Judgement(float(score), float(iou), residual, float(free))

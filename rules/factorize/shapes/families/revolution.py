"""Estimate axis, radii and cavity of a surface of revolution from the points and normals of one view."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry.revolution import vertical_axis

from ..evidence import Evidence
from .box import SMALLEST_M


def axis(evidence: Evidence) -> tuple[np.ndarray, float]:
    """Position (2,) of the vertical axis that the seen normals point towards or away from, and the typical radius [m].

    A surface of revolution, convex or the inside of a cup, has all its normals in planes through the axis.
    """
    level = np.linalg.norm(evidence.normals[:, :2], axis=1)
    side = level > 0.35
    if side.sum() < 30:
        middle = np.median(evidence.points[:, :2], axis=0)
        return middle, float(np.quantile(np.linalg.norm(evidence.points[:, :2] - middle, axis=1), 0.95))
    points, normals = evidence.points[side, :2], evidence.normals[side, :2] / level[side, None]
    centre = vertical_axis(points, normals)
    return centre, float(np.median(np.linalg.norm(points - centre, axis=1)))


def sides(evidence: Evidence, centre: np.ndarray) -> np.ndarray:
    """Cosine (N,) between the level part of each normal and the direction away from the axis: 1 outside, -1 inside."""
    out = evidence.points[:, :2] - centre
    out = out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-9)
    return np.asarray((evidence.normals[:, :2] * out).sum(axis=1))


def interior(evidence: Evidence, centre: np.ndarray) -> float:
    """Fraction of the trusted points on walls facing the axis, well below the rim: evidence of a cavity."""
    below = evidence.points[:, 2] < evidence.height - 0.006
    return float(((sides(evidence, centre) < -0.35) & below).mean())


def outer_radii(evidence: Evidence, centre: np.ndarray, typical: float, heights: np.ndarray) -> np.ndarray:
    """Radius at each height from the points that face away from the axis [m]; gaps are interpolated."""
    outside = sides(evidence, centre) > 0.3
    radius = np.linalg.norm(evidence.points[:, :2] - centre, axis=1)
    reach = max((heights[1] - heights[0]) * 0.7, 0.004)
    found = np.full(len(heights), np.nan)
    for i, height in enumerate(heights):
        near = outside & (np.abs(evidence.points[:, 2] - height) < reach)
        if near.sum() > 8:
            found[i] = np.median(radius[near])
    good = np.isfinite(found)
    if not good.any():
        return np.full(len(heights), max(typical, SMALLEST_M))
    return np.asarray(np.interp(heights, heights[good], found[good]))


def cavity_floor(evidence: Evidence, centre: np.ndarray, typical: float, wall_m: float) -> float:
    """Height of the cavity's floor [m]: the lowest seen inner point, or one wall thickness if hidden."""
    inside = (sides(evidence, centre) < 0.0) | (evidence.normals[:, 2] > 0.9)
    inside &= np.linalg.norm(evidence.points[:, :2] - centre, axis=1) < typical
    inside &= evidence.points[:, 2] < 0.5 * evidence.height
    if inside.sum() < 30:
        return wall_m
    return float(np.clip(np.quantile(evidence.points[inside, 2], 0.1), wall_m, 0.5 * evidence.height))

"""The direction up by the vanishing point of upright edges in a picture, for captures without gravity.

Segments are found by LSD (Grompone von Gioi et al., PAMI 2010). Two segments meet in a candidate for the vanishing
point of the vertical; the one towards which most length points is refined by least squares. Edges of a table run
upwards in the picture as well, so only directions are considered that a camera has which is held about level and looks
at a table or ahead, and nothing is returned where a second point explains nearly as much, or where the segments are few
or close together. A picture from straight above shows no upright edges, and a picture that is turned has false ones.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

LEAST = 0.04
"""Least length of a segment, as a fraction of the picture's height."""
STEEP = 0.5
"""Least vertical part of a segment's direction."""
MOST = 120
"""Number of the longest segments that are paired."""
OFF_RAD = np.radians(1.5)
"""Deviation from the direction to a vanishing point at which a segment counts no more [rad]."""
ROLL_RAD = np.radians(15.0)
"""Largest roll of the camera [rad]."""
LOWEST, HIGHEST = np.sin(np.radians(-5.0)), np.sin(np.radians(65.0))
"""Sines of the least and the largest pitch below the horizontal."""
OTHER_RAD = np.radians(10.0)
"""Angle from which another vanishing point differs [rad]."""
LINES, LENGTH, SPREAD, SECOND = 7, 0.45, 0.25, 0.62
"""Least number of segments; least length of them, as a fraction of the picture's height, and extent across it at focal
length 1; largest share of a second vanishing point. See the page of benchmarks on real tables."""


class Uprights(NamedTuple):
    """The direction up."""

    direction: np.ndarray  # (3,) unit, in the camera frame
    lines: int


class _Segments(NamedTuple):
    middles: np.ndarray  # (N, 2) at focal length 1
    along: np.ndarray  # (N, 2) unit
    planes: np.ndarray  # (N, 3) unit normals of the planes through the camera
    lengths: np.ndarray  # (N,) fractions of the picture's height


def find(pixels: np.ndarray, k: np.ndarray) -> Uprights | None:
    """The direction up; None if upright edges do not tell it.

    Args:
        pixels: (H, W, 3) uint8, its upper side up.
        k: (3, 3) intrinsics [px].
    """
    segments = _segments(pixels, k)
    directions = _meetings(segments.planes)
    if len(segments.lengths) < LINES or not len(directions):
        return None
    scores = _weights(directions, segments).sum(axis=1)
    down = directions[int(scores.argmax())]
    others = np.abs(directions @ down) < np.cos(OTHER_RAD)
    for _ in range(5):
        weights = _weights(down[None], segments)[0]
        spread = (segments.planes * weights[:, None]).T @ segments.planes
        down = np.linalg.eigh(spread)[1][:, 0]
        down = down * np.sign(down[1] or 1.0)
    used = weights > 0
    enough = (
        np.count_nonzero(used) >= LINES,
        scores.max() >= LENGTH,
        np.ptp(segments.middles[used, 0]) >= SPREAD if used.any() else False,
        scores[others].max(initial=0.0) <= SECOND * scores.max(),
        bool(_possible(down[None])[0]),
    )
    return Uprights(-down, int(used.sum())) if all(enough) else None


def _segments(pixels: np.ndarray, k: np.ndarray) -> _Segments:
    """The longest steep segments."""
    import cv2

    grey = cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY)
    found = cv2.createLineSegmentDetector(cv2.LSD_REFINE_ADV).detect(grey)[0]
    ends = np.zeros((0, 2, 2)) if found is None else found.reshape(-1, 2, 2).astype(np.float64)
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / len(pixels)
    rays = np.concatenate([ends, np.ones((len(ends), 2, 1))], axis=2) @ np.linalg.inv(k).T
    along = rays[:, 1, :2] - rays[:, 0, :2]
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    kept = np.flatnonzero((lengths > LEAST) & (np.abs(along[:, 1]) > STEEP))
    kept = kept[np.argsort(-lengths[kept], kind="stable")[:MOST]]
    planes = np.cross(rays[kept, 0], rays[kept, 1])
    planes /= np.linalg.norm(planes, axis=1, keepdims=True)
    return _Segments(rays[kept].mean(axis=1)[:, :2], along[kept], planes, lengths[kept])


def _meetings(planes: np.ndarray) -> np.ndarray:
    """Unit directions down (M, 3) in which two of the planes (N, 3) meet, that a camera may have."""
    one, other = np.triu_indices(len(planes), 1)
    found = np.cross(planes[one], planes[other])
    size = np.linalg.norm(found, axis=1)
    found = found[size > 0.02] / size[size > 0.02, None]
    found = found * np.where(found[:, 1:2] < 0, -1.0, 1.0)
    return np.asarray(found[_possible(found)])


def _possible(down: np.ndarray) -> np.ndarray:
    rolled = np.abs(np.arctan2(down[:, 0], down[:, 1])) < ROLL_RAD
    return np.asarray(rolled & (down[:, 2] > LOWEST) & (down[:, 2] < HIGHEST))


def _weights(directions: np.ndarray, segments: _Segments) -> np.ndarray:
    """Length (M, N) of every segment that points to the vanishing point of every direction (M, 3)."""
    towards = directions[:, None, :2] - directions[:, None, 2:] * segments.middles
    across = towards[..., 0] * segments.along[:, 1] - towards[..., 1] * segments.along[:, 0]
    sine = np.abs(across) / np.maximum(np.linalg.norm(towards, axis=2), 1e-12)
    return np.asarray(segments.lengths * np.clip(1.0 - np.square(sine / np.sin(OFF_RAD)), 0.0, None))

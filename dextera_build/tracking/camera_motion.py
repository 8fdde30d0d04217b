"""Motion of the camera between two frames, from points of the static scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import planes, transforms
from dextera_build.tracking.frame import Frame

BLOCK = 30
"""Side of the squares that contribute one point each [px]."""
STILL_PX = 0.35
"""Median displacement of points below which the camera is static [px]."""
FEWEST = 12
"""Minimum number of points that determine a motion."""
_TRIALS = 120
_MATCHES = 700


@dataclass(frozen=True)
class Ways:
    """Pixels (N, 2) of one frame, and their positions in the next."""

    before: np.ndarray
    after: np.ndarray


def flow(first: Frame, second: Frame, extra: np.ndarray) -> Ways:
    """Textured points, tracked by pyramidal Lucas-Kanade with a forward-backward check.

    Args:
        first: The earlier frame.
        second: The later frame.
        extra: (M, 2) further pixels to follow.
    """
    import cv2

    start = np.concatenate([_corners(first), extra.astype(np.float32)])[:, None]
    if not len(start):
        return Ways(np.zeros((0, 2)), np.zeros((0, 2)))  # a black picture
    options = {"winSize": (15, 15), "maxLevel": 3}
    end, found, _ = cv2.calcOpticalFlowPyrLK(first.grey, second.grey, start, None, **options)
    back, again, _ = cv2.calcOpticalFlowPyrLK(second.grey, first.grey, end, None, **options)
    good = (found[:, 0] > 0) & (again[:, 0] > 0) & (np.abs(back - start)[:, 0].max(axis=1) < 1.0)
    inside = ((end[:, 0] >= 0) & (end[:, 0] <= np.array(first.shape[::-1]) - 1)).all(axis=1)
    good &= inside
    return Ways(start[good, 0].astype(np.float64), end[good, 0].astype(np.float64))


def matched(first: Frame, second: Frame) -> Ways:
    """Mutually best ORB matches (Rublee et al. 2011), for frames that are far apart."""
    import cv2

    finder = cv2.ORB_create(_MATCHES)
    ends = [finder.detectAndCompute(frame.grey, None) for frame in (first, second)]
    if any(descriptors is None for _, descriptors in ends):
        return Ways(np.zeros((0, 2)), np.zeros((0, 2)))
    pairs = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True).match(ends[0][1], ends[1][1])
    pairs = [pair for pair in pairs if pair.distance < 64]
    before = np.array([ends[0][0][pair.queryIdx].pt for pair in pairs]).reshape(-1, 2)
    return Ways(before, np.array([ends[1][0][pair.trainIdx].pt for pair in pairs]).reshape(-1, 2))


def motion(first: Frame, second: Frame, ways: Ways, ignored: np.ndarray) -> np.ndarray | None:
    """T_second_first (4, 4) of the scene, the inverse of the camera's motion; None if undetermined.

    Three-point RANSAC over pairs with depth, then least squares of the inliers. A static camera yields exactly the
    identity.

    Args:
        first: The earlier frame.
        second: The later frame.
        ways: Pixels in both.
        ignored: (H, W) bool, pixels of the first frame that may belong to moving objects.
    """
    at, to = (np.round(each).astype(np.int64) for each in (ways.before, ways.after))
    at, to = (each.clip(0, np.array(first.shape[::-1]) - 1) for each in (at, to))
    source, target = first.measured(at[:, 1], at[:, 0]), second.measured(to[:, 1], to[:, 0])
    fits = (source[:, 2] > 0) & (target[:, 2] > 0) & ~ignored[at[:, 1], at[:, 0]]
    if fits.sum() < FEWEST:
        return None
    source, target = source[fits], target[fits]
    way = np.linalg.norm(ways.after[fits] - ways.before[fits], axis=1)
    if np.median(way) < STILL_PX and (way < 3 * STILL_PX).mean() > 0.6:
        return np.eye(4)
    return consensus(source, target)


def consensus(source: np.ndarray, target: np.ndarray, fewest: int = FEWEST) -> np.ndarray | None:
    """The rigid motion (4, 4) with most inliers among pairs of points (N, 3), by three-point RANSAC, or None.

    Args:
        source: Points [m].
        target: The same points in the frame of a depth camera [m].
        fewest: Minimum number of inliers.
    """
    limit = 0.006 + 3.0 * planes.depth_sigma(target[:, 2])
    random = np.random.default_rng(0)  # deterministic: equal frames give equal results
    turns, shifts = _of_triples(source, target, random.integers(0, len(source), (_TRIALS, 3)))
    apart = np.linalg.norm(source @ turns.swapaxes(1, 2) + shifts[:, None] - target, axis=2) < limit
    counts = apart.sum(axis=1)
    best, most = apart[int(counts.argmax())], int(counts.max())
    if most < fewest or most < 0.25 * len(source):
        return None
    found = np.eye(4)
    for _ in range(3):
        found = transforms.umeyama(source[best], target[best], with_scale=False)[1]
        best = np.linalg.norm(transforms.apply(found, source) - target, axis=1) < limit
        if best.sum() < fewest:
            return None
    return found


def _of_triples(source: np.ndarray, target: np.ndarray, picks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (T, 3, 3) and translations (T, 3) that align triples of points (T, 3) (Kabsch)."""
    one, other = source[picks], target[picks]
    middle, there = one.mean(axis=1), other.mean(axis=1)
    u, _, vt = np.linalg.svd(np.einsum("tni,tnj->tij", other - there[:, None], one - middle[:, None]))
    u[:, :, 2] *= np.linalg.det(u @ vt)[:, None]
    turns = u @ vt
    return turns, there - np.einsum("tij,tj->ti", turns, middle)


def _corners(frame: Frame) -> np.ndarray:
    """The pixel with the largest brightness gradient of each square (N, 2) float32, where there is depth."""
    right, down = frame.slopes
    height, width = (side // BLOCK * BLOCK for side in frame.shape)
    steep = (np.abs(right) + np.abs(down))[:height, :width] * (frame.depth[:height, :width] > 0)
    blocks = steep.reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK).swapaxes(1, 2).reshape(-1, BLOCK * BLOCK)
    best = blocks.argmax(axis=1)
    row, column = np.divmod(np.arange(len(blocks)), width // BLOCK)
    pixels = np.stack([column * BLOCK + best % BLOCK, row * BLOCK + best // BLOCK], axis=1)
    return np.asarray(pixels[blocks.max(axis=1) > 4.0], np.float32)

"""Features of a textured object, by which it is found again at any position and orientation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from dextera_build.tracking import camera_motion
from dextera_build.tracking.frame import Frame
from dextera_build.tracking.model import Cast, State

FEWEST = 7
"""Minimum number of matches that agree with one pose."""
_FEATURES = 1500
_RATIO = 0.8
"""Largest ratio of the distances to the nearest and to the second nearest descriptor (Lowe 2004)."""
Features = tuple[np.ndarray, np.ndarray]
"""Pixels (N, 2) and descriptors (N, 128) float32."""


@dataclass(frozen=True)
class Landmarks:
    """Features (N, 128) of one view of an object, and their positions on its first link (N, 3) [m]."""

    descriptors: np.ndarray
    points: np.ndarray


def of(frame: Frame, cast: Cast) -> Landmarks | None:
    """SIFT features (Lowe 2004) inside the ray-cast model; None if there are too few."""
    import cv2

    top, left, side = int(cast.rows[0]), int(cast.columns[0]), cast.stride
    inner = cv2.erode((cast.link == 0).astype(np.uint8), np.ones((3, 3), np.uint8))
    mask = np.repeat(np.repeat(inner, side, axis=0), side, axis=1)
    crop = np.ascontiguousarray(frame.grey[top : top + mask.shape[0], left : left + mask.shape[1]])
    pixels, descriptors = _detected(crop, np.ascontiguousarray(mask[: crop.shape[0], : crop.shape[1]]))
    if len(pixels) < 2 * FEWEST:
        return None
    cell = np.round(pixels[:, ::-1] / side).astype(np.int64).clip(0, np.array(cast.drawn.shape) - 1)
    points, there = cast.points[cell[:, 0], cell[:, 1]].astype(np.float64), cast.link[cell[:, 0], cell[:, 1]] == 0
    return Landmarks(descriptors[there], points[there]) if there.sum() >= 2 * FEWEST else None


def features(frame: Frame) -> Features:
    """All features of a frame."""
    return _detected(frame.grey, None)


def found(landmarks: Landmarks, frame: Frame, seen: Features, joints: np.ndarray) -> State | None:
    """The state in which landmarks fit their matches in a frame, by their depth; None if few agree.

    Args:
        landmarks: Landmarks of a stored view.
        frame: The current frame.
        seen: Its `features`.
        joints: Joint positions of the state.
    """
    import cv2

    if len(seen[0]) < FEWEST:
        return None
    both = [pair for pair in cv2.BFMatcher().knnMatch(landmarks.descriptors, seen[1], k=2) if len(pair) == 2]
    pairs = [first for first, second in both if first.distance < _RATIO * second.distance]
    points = landmarks.points[[pair.queryIdx for pair in pairs]].reshape(-1, 3)
    pixels = np.round(seen[0][[pair.trainIdx for pair in pairs]].reshape(-1, 2)).astype(np.int64)
    target = frame.measured(pixels[:, 1], pixels[:, 0])
    points, target = points[target[:, 2] > 0], target[target[:, 2] > 0]
    if len(points) < FEWEST:
        return None
    pose = camera_motion.consensus(points, target, FEWEST)
    return None if pose is None else State(pose, joints)


@cache
def _finder() -> Any:
    import cv2

    return cv2.SIFT_create(_FEATURES, contrastThreshold=0.02)


def _detected(grey: np.ndarray, mask: np.ndarray | None) -> Features:
    spots, descriptors = _finder().detectAndCompute(grey, mask)
    if descriptors is None:
        return np.zeros((0, 2)), np.zeros((0, 128), np.float32)
    return np.array([spot.pt for spot in spots]), np.asarray(descriptors)

"""Backend `sift` of align.matches: SIFT, mutual nearest neighbours, and the ratio test."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.cameras.matches import Matches
from dextera_build.rule import Backend, Context, Options

if TYPE_CHECKING:
    from .matches import MatchesOptions

BACKEND = Backend(
    summary="SIFT with mutual nearest neighbours",
    profiles=("cpu",),
    packages=("opencv-python-headless",),
    extra="twin",
)


class SiftOptions(Options):
    """Options of backend `sift` of align.matches."""

    ratio: float = Field(0.8, gt=0.0, le=1.0)
    """Maximum ratio of the distances to the nearest and second nearest descriptor (Lowe, 2004)."""


@dataclass(frozen=True)
class Points:
    """Points of one picture."""

    pixels: np.ndarray  # (N, 2) column and row [px]
    descriptors: np.ndarray  # (N, 128) float32


def match(ctx: Context, first: Image, second: Image, common: MatchesOptions, options: SiftOptions) -> Matches:
    """Pairs of mutually nearest descriptors; the confidence is 1 minus the ratio of distances."""
    return paired(points_of(first, common.points), points_of(second, common.points), options.ratio)


def points_of(picture: Image, most: int, contrast: float = 0.04) -> Points:
    """SIFT keypoints of a picture, at most about so many, of at least this contrast (0..1)."""
    import cv2

    detector = cv2.SIFT_create(nfeatures=most, contrastThreshold=contrast, enable_precise_upscale=True)
    found, descriptors = detector.detectAndCompute(cv2.cvtColor(picture.pixels, cv2.COLOR_RGB2GRAY), None)
    pixels = np.array([point.pt for point in found]).reshape(-1, 2)
    return Points(pixels, np.zeros((0, 128), np.float32) if descriptors is None else descriptors)


def paired(first: Points, second: Points, most: float) -> Matches:
    """Mutually nearest pairs that pass the ratio test with `most`."""
    import cv2

    if min(len(first.pixels), len(second.pixels)) < 2:
        nothing = np.zeros((0, 2))
        return Matches(first=nothing, second=nothing, confidence=np.zeros(0, np.float32), method="SIFT")
    matcher = cv2.BFMatcher(cv2.NORM_L2)
    there = matcher.knnMatch(first.descriptors, second.descriptors, k=2)
    back = {each[0].queryIdx: each[0].trainIdx for each in matcher.knnMatch(second.descriptors, first.descriptors, k=1)}
    pairs = [
        (near.queryIdx, near.trainIdx, near.distance / max(far.distance, 1e-9))
        for near, far in there
        if back[near.trainIdx] == near.queryIdx
    ]
    kept = np.array([pair for pair in pairs if pair[2] <= most]).reshape(-1, 3)
    left, right = kept[:, 0].astype(int), kept[:, 1].astype(int)
    confidence = (1.0 - kept[:, 2]).astype(np.float32)
    return Matches(first=first.pixels[left], second=second.pixels[right], confidence=confidence, method="SIFT")

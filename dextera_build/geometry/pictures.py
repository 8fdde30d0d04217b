"""Pixel-level identity of pictures, and representative points of masks."""

from __future__ import annotations

import numpy as np

from dextera_build import digest


def digest_of(pixels: np.ndarray) -> str:
    """SHA-256 of the size and the pixels of a picture, (H, W, C) uint8; the file format does not matter."""
    size = ",".join(map(str, pixels.shape))
    return digest.of_bytes(size.encode() + b"\n" + np.ascontiguousarray(pixels, np.uint8).tobytes())


def innermost(mask: np.ndarray) -> tuple[int, int]:
    """Column and row of the pixel of `mask` (H, W) bool that is farthest from its border [px]."""
    import cv2

    inside = cv2.distanceTransform(np.pad(mask, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
    row, column = np.unravel_index(int(np.argmax(inside)), mask.shape)
    return int(column), int(row)

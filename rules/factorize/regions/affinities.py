"""Which pixels lie on one object, by a convolutional network that sees the whole photograph.

The network sees colours, heights, slopes and gaps of the depth, at a focal length of about `FOCAL_PX`. For every
second of its pixels in both directions it gives the log odds that the pixels `REACHES` steps to the right, below, and
on both diagonals are of the same object (affinities; Lee, Zung, Li, Jain, Seung: Superhuman accuracy on the SNEMI3D
connectomics challenge, 2017). `bonds` adds them to what it knows of two groups.

`python -m tests.benchmarks.affinities` draws the pictures, trains the network, and writes `affinities.onnx`.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from dextera_build.geometry import planes

from ..measured import Workspace
from .heights import Relief

FILE = Path(__file__).with_name("affinities.onnx")
"""The weights."""
DIGEST = "0478fceb5428732a0b75c1468ab469b7708a7dbd9a22182abbcb635946285a48"
"""Their SHA-256; by it, what was made with other weights is made again."""
FOCAL_PX = 300.0
"""Focal length that the network sees; longer ones are reduced by whole factors [px]."""
COARSE = 2
"""Pixels of the network's picture per pixel of its answer."""
REACHES = (1, 3, 8, 16)
"""Distances of two pixels of the answer."""
DIRECTIONS = ((0, 1), (1, 0), (1, 1), (1, -1))
"""Rows down and columns right of the second pixel, for a reach of 1."""
OFFSETS = tuple((reach * down, reach * right) for reach in REACHES for down, right in DIRECTIONS)
PLANES = 13
"""Planes of the network's input."""
LARGEST = 2.1
"""Largest value of a plane."""
MULTIPLE = 16
"""Width and height of the network's picture are multiples of this [px]."""
MOST = 4.0
"""Largest log odds that count."""


@dataclass(frozen=True)
class Answer:
    """What the network says of a photograph."""

    odds: np.ndarray
    """(len(OFFSETS), h, w) log odds that a pixel and the one at an offset are of one object."""
    size: int
    """Pixels of the photograph per pixel of the answer, along each side."""

    def sampled(self, labels: np.ndarray, left: int, top: int, block: int) -> np.ndarray:
        """Labels of a crop at `left` and `top`, in blocks of `block` px, at the pixels of the answer; 0 outside."""
        found = np.zeros(self.odds.shape[1:], labels.dtype)
        starts = zip(found.shape, (top, left), labels.shape, strict=True)
        places = [((np.arange(1, n + 1) * self.size - 1 - start) // block, most) for n, start, most in starts]
        (rows, columns), inside = (at for at, _ in places), [(at >= 0) & (at < most) for at, most in places]
        found[np.ix_(*inside)] = labels[np.ix_(rows[inside[0]], columns[inside[1]])]
        return found


def ask(seen: Workspace, relief: Relief, lab: np.ndarray) -> Answer:
    """Run the network on a photograph with the colours `lab` (H, W, 3) CIE Lab.

    Raises:
        ValueError: The file of the weights is not the one that belongs to this version.
    """
    import cv2

    cv2.setNumThreads(1)
    picture = inputs(seen, relief, lab)
    more = [(0, -n % MULTIPLE) for n in picture.shape[1:]]
    network = _network()
    network.setInput(np.pad(picture, [(0, 0), *more], mode="edge")[None])
    height, width = (-(-n // COARSE) for n in picture.shape[1:])
    return Answer(np.array(network.forward()[0, : len(OFFSETS), :height, :width]), COARSE * stride(seen.camera.fx))


@cache
def _network() -> Any:
    import cv2

    data = FILE.read_bytes()
    if hashlib.sha256(data).hexdigest() != DIGEST:
        raise ValueError(f"{FILE.name} has other weights than this version of dxb: install it again")
    return cv2.dnn.readNetFromONNX(np.frombuffer(data, np.uint8))


def stride(focal_px: float) -> int:
    """Pixels of the photograph per pixel of the network's picture."""
    return max(1, round(focal_px / FOCAL_PX))


def inputs(seen: Workspace, relief: Relief, lab: np.ndarray) -> np.ndarray:
    """What the network sees, (PLANES, h, w) float32; its values are mostly within -1 and 1."""
    import cv2

    step = stride(seen.camera.fx)
    pick = (slice(step // 2, None, step), slice(step // 2, None, step))
    depth = seen.depth[pick].astype(np.float32)
    small = cv2.resize(lab, depth.shape[::-1], interpolation=cv2.INTER_AREA)
    valid = depth > 0
    inverse = np.where(valid, 1.0 / np.where(valid, depth, 1.0), 0.0).astype(np.float32)
    height = np.where(valid, relief.height[pick], 0.0).astype(np.float32)
    noise = planes.depth_sigma(depth.astype(np.float64))
    found = [
        small[..., 0] / 50.0 - 1.0,
        small[..., 1] / 40.0,
        small[..., 2] / 40.0,
        np.clip(height / 0.02, -1.5, 1.5),
        np.tanh(height / 0.15),
        (relief.raised & (relief.over | relief.continued))[pick],
        valid,
        *_slopes(inverse, seen.k, step),
        *(_nearer(inverse, side) / 0.01 for side in (5, 25)),
        np.minimum(noise / 0.005, 2.0),
    ]
    return np.clip(np.stack(found).astype(np.float32), -LARGEST, LARGEST)


def _slopes(inverse: np.ndarray, k: np.ndarray, step: int) -> np.ndarray:
    """Normals in the camera frame (3, h, w); 0 where the depth around is not measured.

    Args:
        inverse: (h, w) inverse depth [1/m], 0 if not measured. That of a plane is linear over the picture.
        k: (3, 3) intrinsics of the photograph [px].
        step: Pixels of the photograph per pixel.
    """
    mean, known = _mean(inverse, 5)
    ahead = np.zeros((2, *inverse.shape), np.float32)
    sure = known & (inverse > 0)
    for axis in (0, 1):
        ahead[axis] = (np.roll(mean, -2, axis) - np.roll(mean, 2, axis)) / 4.0
        sure &= np.roll(known, -2, axis) & np.roll(known, 2, axis)
    sure[[0, 1, -2, -1]] = sure[:, [0, 1, -2, -1]] = False
    rows, columns = np.mgrid[0 : inverse.shape[0], 0 : inverse.shape[1]].astype(np.float32)
    fx, fy = k[0, 0] / step, k[1, 1] / step
    base = mean - ahead[1] * (columns - k[0, 2] / step) - ahead[0] * (rows - k[1, 2] / step)
    normal = np.stack([ahead[1] * fx, ahead[0] * fy, base])
    return np.where(sure, normal / np.maximum(np.linalg.norm(normal, axis=0), 1e-9), 0.0)


def _nearer(inverse: np.ndarray, side: int) -> np.ndarray:
    """How much nearer each pixel (h, w) is than the measured ones around it, in parts of its depth."""
    mean, known = _mean(inverse, side)
    return np.where(known & (inverse > 0), inverse / np.maximum(mean, 1e-9) - 1.0, 0.0)


def _mean(values: np.ndarray, side: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean (h, w) of the values above 0 in a square window, and where at least a fifth of it has any."""
    import cv2

    total = cv2.boxFilter(values, -1, (side, side), borderType=cv2.BORDER_REPLICATE)
    count = cv2.boxFilter((values > 0).astype(np.float32), -1, (side, side), borderType=cv2.BORDER_REPLICATE)
    return total / np.maximum(count, 1e-6), count > 0.2


def nothing() -> np.ndarray:
    """What `between` says of a pair that is beyond all reaches."""
    return np.zeros((2, len(REACHES)))


def between(odds: np.ndarray, labels: np.ndarray) -> dict[tuple[int, int], np.ndarray]:
    """What the network says of each pair of labels (smaller, larger): sums of log odds, and numbers of pairs.

    Args:
        odds: (len(OFFSETS), h, w) log odds.
        labels: (h, w) int, 0 for none.

    Returns:
        Pair -> (2, len(REACHES)): sums of the log odds, each within +-MOST, and how many they are.
    """
    found: dict[tuple[int, int], np.ndarray] = {}
    height, width = labels.shape
    for number, (down, right) in enumerate(OFFSETS):
        rows, columns = slice(0, height - down), slice(max(0, -right), width - max(0, right))
        a = labels[rows, columns]
        b = labels[down:, max(0, right) : width + min(0, right)]
        apart = (a != b) & (a > 0) & (b > 0)
        said = np.clip(odds[number][rows, columns][apart], -MOST, MOST)
        one, other = a[apart].astype(np.int64), b[apart].astype(np.int64)
        keys, place = np.unique(np.minimum(one, other) * 100000 + np.maximum(one, other), return_inverse=True)
        sums, counts = np.bincount(place, weights=said), np.bincount(place)
        for key, total, count in zip(keys.tolist(), sums, counts, strict=True):
            pair = found.setdefault((key // 100000, key % 100000), nothing())
            pair[:, number // len(DIRECTIONS)] += total, count
    return found

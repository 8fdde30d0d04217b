"""Smooth surface patches above the support, bounded by creases and depth steps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import cameras, normals, planes, transforms

from ..measured import Workspace
from .heights import Relief

FOCAL_PX = 600.0
"""Images with a longer focal length are reduced in blocks to keep pixel distances comparable."""
SPAN = 3
"""Half distance over which creases and steps are detected [px]."""
CREASE_RAD = 0.38
"""Turn of the normal within twice the span that separates two patches [rad]."""
NEIGHBOURS = ((0, 1), (1, 0), (1, 1), (1, -1))


@dataclass(frozen=True)
class Surfaces:
    """Per-pixel geometry of a crop of the image, in blocks of `stride` x `stride` px."""

    left: int
    top: int
    stride: int
    points: np.ndarray  # (h, w, 3) world [m]
    height: np.ndarray  # (h, w) [m]
    inverse: np.ndarray  # (h, w) inverse depth [1/m], 0 where not raised or not measured
    tolerance: np.ndarray  # (h, w) standard deviation of inverse depth [1/m]
    sharp: normals.LocalPlanes
    normal: np.ndarray  # (h, w, 3) world, 0 if unknown
    raised: np.ndarray  # (h, w) bool
    floor: np.ndarray  # (h, w) bool, measured pixels of the support
    beyond: np.ndarray  # (h, w) depth of surfaces below or next to the support [m], 0 elsewhere
    pixel_m2: np.ndarray  # (h, w) area covered by a block, face on [m^2]
    lab: np.ndarray  # (h, w, 3) float32 CIE L*a*b*
    eye: np.ndarray  # (3,) the camera in the world [m]

    def full(self, labels: np.ndarray, mask: np.ndarray) -> np.ndarray:
        """Expand block labels to the pixels of a full-size mask; pixels next to a block get its label."""
        blown = np.repeat(np.repeat(labels, self.stride, axis=0), self.stride, axis=1)
        found = np.zeros(mask.shape, labels.dtype)
        height, width = found[self.top :, self.left :].shape
        blown = blown[:height, :width]
        found[self.top : self.top + blown.shape[0], self.left : self.left + blown.shape[1]] = blown
        return np.where(mask, spread(found, mask, self.stride + 1), 0)


def surfaces(relief: Relief, raised: np.ndarray, seen: Workspace, lab: np.ndarray) -> Surfaces:
    """Local planes and normals of the raised pixels, in their bounding crop with a margin of 8 blocks."""
    camera = seen.camera
    stride = max(1, round(camera.fx / FOCAL_PX))
    rows, columns = np.nonzero(raised)
    top, left = max(0, int(rows.min()) - 8 * stride), max(0, int(columns.min()) - 8 * stride)
    box = (slice(top, int(rows.max()) + 8 * stride), slice(left, int(columns.max()) + 8 * stride))
    depth = blocks(np.where(raised, seen.depth, 0.0)[box].astype(np.float64), stride)
    near = nearest(depth)
    mask = np.asarray(near.any(axis=-1))
    mean = (depth * near).sum(axis=-1) / np.maximum(near.sum(axis=-1), 1)
    inverse = np.where(mask, 1.0 / np.where(mask, mean, 1.0), 0.0)
    tolerance = np.where(mask, planes.depth_sigma(mean) * np.square(inverse), 1.0)
    sharp = normals.sharpen(normals.fit(inverse, tolerance), inverse, tolerance)
    k = camera.crop(left, top, camera.width, camera.height).matrix()
    k[:2] /= stride
    k[:2, 2] -= (stride - 1) / (2 * stride)
    points = transforms.apply(seen.world_from_camera, cameras.backproject(mean, k))
    heights = (blocks(relief.height[box], stride) * near).sum(axis=-1) / np.maximum(near.sum(axis=-1), 1)
    outside = relief.valid[box] & (
        (relief.height[box] < -relief.threshold[box]) | ~(relief.over | relief.continued)[box]
    )
    level = np.abs(relief.height[box]) <= relief.threshold[box]
    floor = blocks(relief.valid[box] & level, stride).mean(axis=-1) > 0.5
    colour = np.stack([blocks(lab[box][..., i], stride).mean(axis=-1) for i in range(3)], axis=-1)
    return Surfaces(
        left=left,
        top=top,
        stride=stride,
        points=points,
        height=heights,
        inverse=inverse,
        tolerance=tolerance,
        sharp=sharp,
        normal=sharp.normals(k) @ seen.world_from_camera[:3, :3].T,
        raised=mask,
        floor=floor & ~mask,
        beyond=blocks(np.where(outside, seen.depth[box], 0.0), stride).max(axis=-1) * ~(floor | mask),
        pixel_m2=np.where(mask, np.square(mean), 0.0) / (k[0, 0] * k[1, 1]),
        lab=colour,
        eye=seen.world_from_camera[:3, 3],
    )


def blocks(values: np.ndarray, stride: int) -> np.ndarray:
    """Pixels (h, w, stride^2) of each block of (H, W), padded by repeating the last row and column."""
    height, width = (-(-n // stride) for n in values.shape)
    padding = [(0, height * stride - values.shape[0]), (0, width * stride - values.shape[1])]
    filled = np.pad(values, padding, mode="edge")
    parts = filled.reshape(height, stride, width, stride).swapaxes(1, 2)
    return np.asarray(parts.reshape(height, width, stride * stride))


def nearest(depth: np.ndarray) -> np.ndarray:
    """Whether each pixel of a block (h, w, n) is on the nearest surface: within 2 % of the smallest valid depth."""
    least = np.where(depth > 0, depth, np.inf).min(axis=-1, keepdims=True)
    return np.asarray((depth > 0) & (depth < 1.02 * least))


def fold(s: Surfaces, rows: np.ndarray, columns: np.ndarray, down: int, right: int) -> tuple[np.ndarray, np.ndarray]:
    """How the surface continues from pixels o to pixels q, offset by (down, right).

    Returns:
        Signed angle between the normals [rad], positive if convex; and the depth step [m], 0 if the two local planes
        meet between o and q.
    """
    far_rows, far_columns = rows + down, columns + right
    n0, n1 = s.normal[rows, columns], s.normal[far_rows, far_columns]
    cosine = np.clip((n0 * n1).sum(axis=-1), -1.0, 1.0)
    along = s.points[far_rows, far_columns] - s.points[rows, columns]
    convex = ((n1 - n0) * along).sum(axis=-1) >= 0
    angle = np.where(convex, 1.0, -1.0) * np.arccos(cosine)
    w0, w1 = s.inverse[rows, columns], s.inverse[far_rows, far_columns]
    ahead = s.sharp.at(rows, columns, np.full_like(rows, down), np.full_like(rows, right)) - w1
    behind = w0 - s.sharp.at(far_rows, far_columns, np.full_like(rows, -down), np.full_like(rows, -right))
    step = np.where(ahead * behind > 0, np.minimum(np.abs(ahead), np.abs(behind)), 0.0)
    return angle, step / np.maximum(w0 * w1, 1e-9)


Span = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, int, int]
"""Rows and columns of pixels, those of the pixels one span before them, and the direction (down, right)."""


def spans(s: Surfaces) -> Iterator[Span]:
    """In each direction, the pixels with a known normal one span before and one span behind them."""
    known = np.linalg.norm(s.normal, axis=-1) > 0
    for down, right in NEIGHBOURS:
        rows, columns = np.nonzero(known)
        r0, c0, r1, c1 = rows - SPAN * down, columns - SPAN * right, rows + SPAN * down, columns + SPAN * right
        inside = (r0 >= 0) & (c0 >= 0) & (c1 >= 0) & (r1 < known.shape[0])
        inside &= (c0 < known.shape[1]) & (c1 < known.shape[1])
        rows, columns, r0, c0, r1, c1 = (x[inside] for x in (rows, columns, r0, c0, r1, c1))
        both = known[r0, c0] & known[r1, c1]
        yield rows[both], columns[both], r0[both], c0[both], down, right


def edges(s: Surfaces) -> np.ndarray:
    """Strength (h, w) of creases and steps around each pixel; patches end at 1."""
    strength = np.zeros(s.inverse.shape)
    for rows, columns, r0, c0, down, right in spans(s):
        angle, step = fold(s, r0, c0, 2 * SPAN * down, 2 * SPAN * right)
        limit = step_limit(s, rows, columns)
        value = np.maximum(np.abs(angle) / CREASE_RAD, step / limit)
        strength[rows, columns] = np.maximum(strength[rows, columns], value)
    return strength


def step_limit(s: Surfaces, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Noise bound of the depth difference at these pixels [m]."""
    w = np.maximum(s.inverse[rows, columns], 1e-6)
    return np.asarray(0.004 + 3.0 * planes.depth_sigma(1.0 / w))


def patches(s: Surfaces, smallest: int = 25) -> np.ndarray:
    """Patch labels (h, w) int32: 1.. on raised pixels, 0 elsewhere."""
    from scipy import ndimage

    known = np.linalg.norm(s.normal, axis=-1) > 0
    calm = known & (edges(s) < 1.0)
    labels, count = ndimage.label(calm)
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    sizes[0] = 0
    keep = np.where(sizes >= smallest, np.arange(count + 1), 0)
    labels = grow(s, keep[labels].astype(np.int32))
    rest, extra = ndimage.label(s.raised & (labels == 0))
    sizes = np.bincount(rest.ravel(), minlength=extra + 1)
    sizes[0] = 0
    rest = np.where(sizes >= smallest, np.arange(extra + 1), 0)[rest]
    labels = np.where(rest > 0, rest + labels.max(), labels)
    labels = spread(labels, s.raised)
    return np.unique(labels, return_inverse=True)[1].reshape(labels.shape).astype(np.int32)


def grow(s: Surfaces, labels: np.ndarray, rounds: int = 12) -> np.ndarray:
    """Assign unlabelled raised pixels to the neighbouring patch whose local plane best predicts their depth."""
    labels = labels.copy()
    a, b, c = s.sharp.a.copy(), s.sharp.b.copy(), s.sharp.c.copy()
    for _ in range(rounds):
        rows, columns = np.nonzero(s.raised & (labels == 0))
        best = np.full(len(rows), 4.0)
        owner = np.zeros(len(rows), np.int64)
        source = np.zeros((2, len(rows)), np.int64)
        for down, right in ((0, 1), (0, -1), (1, 0), (-1, 0)):
            r, q = np.clip(rows + down, 0, labels.shape[0] - 1), np.clip(columns + right, 0, labels.shape[1] - 1)
            predicted = c[r, q] - a[r, q] * right - b[r, q] * down
            cost = np.abs(predicted - s.inverse[rows, columns]) / s.tolerance[rows, columns]
            better = (labels[r, q] > 0) & (cost < best)
            best[better], owner[better] = cost[better], labels[r, q][better]
            source[0][better], source[1][better] = down, right
        won = owner > 0
        if not won.any():
            break
        rows, columns, (down, right) = rows[won], columns[won], source[:, won]
        labels[rows, columns] = owner[won]
        r, q = rows + down, columns + right
        c[rows, columns] = c[r, q] - a[r, q] * right - b[r, q] * down
        a[rows, columns], b[rows, columns] = a[r, q], b[r, q]
    return labels


def spread(labels: np.ndarray, mask: np.ndarray, reach: float = 6.0) -> np.ndarray:
    """Assign the unlabelled pixels of a mask to the nearest label within `reach` px."""
    from scipy import ndimage

    distance, (rows, columns) = ndimage.distance_transform_edt(labels == 0, return_indices=True)
    near = mask & (labels == 0) & (distance <= reach)
    return np.where(near, labels[rows, columns], labels)

"""Reduction of points on the same surfaces."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.spatial.point_cloud import PointCloud

HALVINGS = 12
"""Number of halvings in the search for the cell size."""
MIXERS = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0xD6E8FEB86659FD93], np.uint64)
"""Odd constants of a hash; two cells of a million collide with a probability of about 1e-7."""


def thinned(points: PointCloud, most: int) -> PointCloud:
    """At most `most` points, each the mean of those in one cell of space.

    The side of a cell is a multiple of the local distance between neighbouring points, so that surfaces near the
    cameras and far from them are reduced equally. Points without attribute `footprint` share one distance.

    Args:
        points: With colours; other attributes than `footprint` are averaged.
        most: At least 1.
    """
    places = points.points.astype(np.float64)
    widths = points.attributes.get("footprint", np.full(len(places), _width(places))).astype(np.float64)
    low, high = 0.0, np.log2(max(float(np.ptp(places, axis=0).max() / widths.min()), 2.0)) + 1
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        few = len(np.unique(_cells(places, widths, middle))) <= most
        low, high = (low, middle) if few else (middle, high)
    _, owner = np.unique(_cells(places, widths, high), return_inverse=True)
    return _joined(points, places, widths * 2.0**high, owner)


def _width(places: np.ndarray) -> float:
    return max(float(np.ptp(places, axis=0).max() / np.sqrt(len(places))), 1e-9)


def _cells(places: np.ndarray, widths: np.ndarray, octaves: float) -> np.ndarray:
    """Hash (N,) of each point's cell, from the cell's size, which doubles in steps, and its position."""
    level = np.round(np.log2(widths))[:, None]
    cells = np.concatenate([level, np.floor(places / 2.0 ** (level + octaves))], axis=1).astype(np.int64)
    mixed = cells.astype(np.uint64) * MIXERS
    return np.asarray(np.bitwise_xor.reduce(mixed ^ (mixed >> np.uint64(29)), axis=1))


def _joined(points: PointCloud, places: np.ndarray, widths: np.ndarray, owner: np.ndarray) -> PointCloud:
    count = np.bincount(owner).astype(np.float64)

    def mean(values: np.ndarray) -> np.ndarray:
        flat = values.reshape(len(values), -1).astype(np.float64)
        sums = np.stack([np.bincount(owner, column) for column in flat.T], axis=1)
        return np.asarray((sums / count[:, None]).reshape(len(count), *values.shape[1:]))

    normals = None
    if points.normals is not None:
        normals = mean(points.normals)
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        # The mean of opposite normals is undefined.
        normals = np.where(length > 0.5, normals / np.maximum(length, 1e-9), 0.0).astype(np.float32)
    attributes = {name: mean(values).astype(np.float32) for name, values in points.attributes.items()}
    return PointCloud(
        points=mean(places).astype(np.float32),
        colours=None if points.colours is None else np.round(mean(points.colours)).astype(np.uint8),
        normals=normals,
        attributes=attributes | {"footprint": mean(widths).astype(np.float32)},
        frame=points.frame,
    )

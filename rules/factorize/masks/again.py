"""The objects of the first photograph in a further one, by their surfaces.

A measured pixel above the support belongs to the object whose seen surface is next to it. A connected region with the
surface of one object is that object, with what the first photograph does not see of it, as far as the first photograph
allows: an object is inside its silhouette there, or hidden.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.objects.view import Instance, Seen
from dextera_build.geometry import cameras, planes, regions, transforms

from ..measured import Workspace
from ..regions.heights import Relief
from ..shapes.evidence import step

NEAR_M, NEAR_SIGMAS = 0.008, 2.0
"""Distance from an object's seen surface within which a point is on it: [m], and in addition in standard deviations."""
SEEDS = 0.02
"""Fraction of a region that must be on an object's seen surface."""
INSIDE_PX = 3
"""Distance from the silhouette in the first photograph within which a point may be an object's [px]."""
FEWEST = 150
"""Minimum number of pixels of an object in a photograph."""
CONTACT_PX, CONTACT_M = 9, 0.02
"""Side of the neighbourhood [px] and difference of depth [m] in which the support touches an object."""


@dataclass(frozen=True)
class Found:
    """Objects in a further photograph."""

    labels: np.ndarray  # (H, W) int32; 1, 2, ... are the objects, in their order
    unknown: np.ndarray  # (H, W) bool, pixels that may be an object's
    strange: int  # pixels above the support, connected with no object


def objects_in(seen: Workspace, relief: Relief, objects: Mapping[str, Instance]) -> Found:
    """Find the objects in a further photograph.

    Args:
        seen: The photograph, in the world of the first one's support.
        relief: Its heights.
        objects: The objects of the first photograph, with depth.
    """
    above = relief.raised & (relief.over | relief.continued)
    depth = seen.depth.astype(np.float64)
    limit = step(planes.depth_sigma(depth))
    jumps = (np.abs(np.diff(depth, axis=axis)) > np.delete(limit, -1, axis=axis) for axis in (1, 0))
    parts, count = regions.connected(above, *jumps)
    labels = np.zeros(above.shape, np.int32)
    nearest = _nearest(seen, above, relief, objects)
    size = np.bincount(parts[above], minlength=count + 1)
    numbers = range(1, len(objects) + 1)
    seeds = np.stack([np.bincount(parts[above & (nearest == n)], minlength=count + 1) for n in numbers])
    holds = seeds > np.maximum(10, SEEDS * size)
    alone = holds.sum(axis=0) == 1
    owner = np.where(alone, holds.argmax(axis=0) + 1, 0)[parts]
    labels[above] = np.where(nearest > 0, nearest, owner)[above]
    for number, one in enumerate(objects.values(), start=1):
        own = labels == number
        own[own] = _possible(relief.points[own], one)
        labels[(labels == number) & ~own] = 0
        if own.sum() < FEWEST:
            labels[own] = 0
    strange = int(size[1:][~holds.any(axis=0)[1:]].sum())
    return Found(labels, _unknown(labels, above, seen.depth), strange)


def _nearest(seen: Workspace, above: np.ndarray, relief: Relief, objects: Mapping[str, Instance]) -> np.ndarray:
    """The object (H, W), 1.., whose seen surface is next to each pixel `above`; 0 for none."""
    from scipy import ndimage
    from scipy.spatial import cKDTree

    clouds, owners = [], []
    for number, one in enumerate(objects.values(), start=1):
        assert one.measured is not None
        own = Seen(one.view, one.measured)
        inner = ndimage.binary_erosion(own.mask, iterations=2) & (own.depth > 0)
        clouds.append(own.world_points(inner)[::2])
        owners.append(np.full(len(clouds[-1]), number))
    found = np.zeros(above.shape, np.int32)
    points = relief.points[above]
    reach = NEAR_M + NEAR_SIGMAS * planes.depth_sigma(seen.depth[above].astype(np.float64))
    distance, index = cKDTree(np.concatenate(clouds)).query(points, distance_upper_bound=float(reach.max(initial=0.01)))
    near = distance < reach
    found[above] = np.where(near, np.append(np.concatenate(owners), 0)[np.where(near, index, -1)], 0)
    return found


def _possible(points: np.ndarray, one: Instance) -> np.ndarray:
    """Which points (N, 3) may be an object's: those inside its silhouette in the first photograph, hidden, or out."""
    from scipy import ndimage

    assert one.measured is not None
    own = Seen(one.view, one.measured)
    local = transforms.apply(transforms.invert(own.world_from_camera), points)
    row, column, inside = cameras.nearest_pixels(local, own.k, own.mask.shape)
    allowed = ndimage.binary_dilation(own.mask | own.occluder, iterations=INSIDE_PX)
    return np.asarray(allowed[row, column] & inside)


def _unknown(labels: np.ndarray, above: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Pixels (H, W) that may be an object's: of a region of several, without depth, or where it touches the support."""
    from scipy import ndimage

    mask = labels > 0
    deepest = ndimage.maximum_filter(np.where(mask, depth, 0.0), CONTACT_PX)
    touches = ~mask & ~above & (deepest > 0) & (np.abs(depth - deepest) < CONTACT_M)
    return np.asarray((above & ~mask) | (depth == 0) | touches)

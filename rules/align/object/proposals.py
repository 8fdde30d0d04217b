"""Starts of a registration: many orientations at once, each with scale and position from the mask, ranked on a grid.

All orientations are scored together as arrays of projected surface points, at a hundredth of the cost of a render each.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dextera_build.artifacts.objects.view import Seen
from dextera_build.geometry import transforms
from dextera_build.geometry.registration import ScaledPose

CELLS = 20
"""Cells of the grid along each side of the mask's box."""
_ROUNDS = 2
"""Number of times that scale and position of a start are corrected by its projection."""
_BESIDE = 2
"""Number of cells around the mask's box in which a projection counts as outside."""
_TAIL = 0.004
"""Fraction of the mask's pixels beyond each side of its box."""
_RELIEF = 0.08
"""Depth difference, relative to the size of the object, with the same cost as no overlap."""
_DIFFERENT = np.radians(18.0)
"""Rotation angle above which two starts differ."""


class Target(NamedTuple):
    """Data that the projections are compared with."""

    low: np.ndarray  # (2,) left and top of the mask's box, in tangents of the angle to the optical axis
    high: np.ndarray  # (2,) right and bottom
    open: np.ndarray  # (2, 2) bool, whether something may hide the object beyond `low` and `high`
    mask: np.ndarray  # (C, C) fraction of each cell in the mask
    known: np.ndarray  # (C, C) bool, cells without an occluder
    depth: np.ndarray  # (C, C) median measured depth of the mask's pixels [m], NaN without one
    middle: float  # median depth [m]


class Starts(NamedTuple):
    """Placements in the camera's frame: x = rotations @ (scales * x_model) + places."""

    rotations: np.ndarray  # (R, 3, 3)
    scales: np.ndarray  # (R,)
    places: np.ndarray  # (R, 3) [m]


def target(seen: Seen) -> Target | None:
    """The grid of a view; None if the mask has no measured pixels."""
    k, mask = seen.camera.matrix(), seen.mask
    rows, columns = np.nonzero(mask)
    tangents = np.stack([(columns - k[0, 2]) / k[0, 0], (rows - k[1, 2]) / k[1, 1]], axis=1)
    half = 0.5 / np.array([k[0, 0], k[1, 1]])
    low = np.quantile(tangents, _TAIL, axis=0) - half
    high = np.quantile(tangents, 1.0 - _TAIL, axis=0) + half
    depth = seen.depth
    if not (mask & (depth > 0)).any():
        return None
    every = np.stack(np.meshgrid(np.arange(mask.shape[1]), np.arange(mask.shape[0])), axis=-1).reshape(-1, 2)
    cell = _cells((every - k[:2, 2]) / [k[0, 0], k[1, 1]], low, high)
    inside = cell >= 0
    count, side = _side() ** 2, _side()
    index = cell[inside]
    total = np.maximum(np.bincount(index, minlength=count), 1)
    covered = np.bincount(index, mask.reshape(-1)[inside], count) / total
    hidden = np.bincount(index, seen.occluder.reshape(-1)[inside], count) / total
    valid = inside & mask.reshape(-1) & (depth.reshape(-1) > 0)
    sums = np.bincount(cell[valid], depth.reshape(-1)[valid], count)
    number = np.bincount(cell[valid], minlength=count)
    near = np.where(number > 0, sums / np.maximum(number, 1), np.nan)
    middle = float(np.median(depth[mask & (depth > 0)]))
    return Target(
        low, high, np.array(_hidden_sides(seen)), covered.reshape(side, side), (hidden < 0.3).reshape(side, side),
        near.reshape(side, side), middle,
    )  # fmt: skip


def fitted(points: np.ndarray, rotations: np.ndarray, goal: Target, grow: float = 1.0) -> Starts:
    """Scale and position of every rotation so that the projection has the mask's box and the measured depth.

    Only unoccluded sides of the box are used. The scale is that of the visible box times `grow`; without it, the scale
    is corrected by axes of which both ends are visible.

    Args:
        points: (N, 3) of the whole surface, model units.
        rotations: (R, 3, 3) R_camera_model.
        goal: See `target`.
        grow: Size relative to that of the visible box.
    """
    turned = np.einsum("rij,nj->rni", rotations, points)
    low, high = turned.min(axis=1), turned.max(axis=1)
    whole = ~goal.open.any(axis=0)
    extent = (goal.high - goal.low) * goal.middle
    use = whole if whole.any() else np.array([True, True])
    scales = grow * np.median(extent[use] / np.maximum(high - low, 1e-12)[:, :2][:, use], axis=1)
    middle = (low + high) / 2.0
    centre = np.append((goal.low + goal.high) / 2.0 * goal.middle, goal.middle)
    # The nearest point of the model corresponds to the nearest seen point.
    places = centre - scales[:, None] * middle + scales[:, None] * (high - low) / 2.0 * [0.0, 0.0, 1.0]
    for _ in range(_ROUNDS):
        spots = scales[:, None, None] * turned + places[:, None, :]
        z = np.maximum(spots[..., 2], 1e-6)
        tangents = spots[..., :2] / z[..., None]
        least, most = tangents.min(axis=1), tangents.max(axis=1)
        distance = (scales[:, None] * middle + places)[:, 2]
        grown = np.ones(len(scales))
        if whole.any() and grow == 1.0:
            ratio = (goal.high - goal.low)[use] / np.maximum(most - least, 1e-12)[:, use]
            grown = np.clip(np.median(ratio, axis=1), 0.5, 2.0)
        anchor = np.where(goal.open[0] & ~goal.open[1], most, np.where(goal.open[1] & ~goal.open[0], least, 0.0))
        both = ~(goal.open[0] ^ goal.open[1])
        anchor = np.where(both, (least + most) / 2.0, anchor)
        wanted = np.where(both, (goal.low + goal.high) / 2.0, np.where(goal.open[0], goal.high, goal.low))
        pivot = np.column_stack([anchor, np.ones(len(anchor))]) * distance[:, None]
        goal_at = np.column_stack([np.broadcast_to(wanted, anchor.shape), np.ones(len(anchor))]) * distance[:, None]
        places = goal_at + grown[:, None] * (places - pivot)
        scales = scales * grown
        depths, _ = _grid(turned, Starts(rotations, scales, places), goal)
        with np.errstate(invalid="ignore"):
            off = _medians(goal.depth[None] - depths)
        # Along the line of sight, so that the projection stays in place.
        distance = (scales[:, None] * middle + places)[:, 2]
        centres = scales[:, None] * middle + places
        places = places + centres * (off / np.maximum(distance, 1e-6))[:, None]
    return Starts(rotations, scales, places)


def costs(points: np.ndarray, starts: Starts, goal: Target) -> np.ndarray:
    """Disagreement (R,) with mask and depth on the grid, 0 to 2."""
    turned = np.einsum("rij,nj->rni", starts.rotations, points)
    depths, outside = _grid(turned, starts, goal)
    drawn = np.isfinite(depths)
    weight = np.where(goal.known, goal.mask, 0.0)
    both = (drawn * weight).sum(axis=(1, 2))
    extra = (drawn * np.where(goal.known, 1.0 - goal.mask, 0.0)).sum(axis=(1, 2))
    union = weight.sum() + extra + outside
    size = starts.scales * float(np.linalg.norm(np.ptp(points, axis=0)))
    with np.errstate(invalid="ignore"):
        off = np.minimum(np.abs(goal.depth - depths) / (_RELIEF * size)[:, None, None], 1.0)
    common = np.isfinite(off)
    relief = np.where(common, off, 0.0).sum(axis=(1, 2)) / np.maximum(common.sum(axis=(1, 2)), 1)
    return np.asarray(1.0 - both / np.maximum(union, 1e-9) + np.where(common.any(axis=(1, 2)), relief, 1.0))


def different(rotations: np.ndarray, ranked: np.ndarray, most: int) -> list[int]:
    """The first `most` of the ranked indices whose rotations differ from all earlier ones."""
    chosen: list[int] = []
    limit = 1.0 + 2.0 * np.cos(_DIFFERENT)
    for index in ranked:
        traces = [float(np.sum(rotations[index] * rotations[other])) for other in chosen]
        if all(trace < limit for trace in traces):
            chosen.append(int(index))
        if len(chosen) == most:
            break
    return chosen


def in_world(starts: Starts, index: int, seen: Seen) -> ScaledPose:
    """One start in the world's frame."""
    local = transforms.rigid(starts.rotations[index], starts.places[index])
    return ScaledPose(float(starts.scales[index]), seen.world_from_camera @ local)


def _side() -> int:
    return CELLS + 2 * _BESIDE


def _cells(tangents: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Cell of each point (..., 2), row by row; -1 outside the grid."""
    at = np.floor((tangents - low) / (high - low) * CELLS).astype(np.int64) + _BESIDE
    inside = ((at >= 0) & (at < _side())).all(axis=-1)
    return np.where(inside, at[..., 1] * _side() + at[..., 0], -1)


def _grid(turned: np.ndarray, starts: Starts, goal: Target) -> tuple[np.ndarray, np.ndarray]:
    """Nearest depth (R, C, C) in each cell, inf without a point; and the number of points outside, in cells."""
    count, cells = len(turned), _side() ** 2
    z = starts.scales[:, None] * turned[..., 2] + starts.places[:, None, 2]
    depth = np.maximum(z, 1e-6)
    flat = (starts.scales[:, None, None] * turned[..., :2] + starts.places[:, None, :2]) / depth[..., None]
    cell = _cells(flat, goal.low, goal.high)
    found = np.full(count * cells + 1, np.inf)
    index = np.where(cell >= 0, cell + np.arange(count)[:, None] * cells, count * cells)
    np.minimum.at(found, index.reshape(-1), depth.reshape(-1))
    outside = (cell < 0).mean(axis=1) * CELLS**2
    return found[:-1].reshape(count, _side(), _side()), outside


def _medians(values: np.ndarray) -> np.ndarray:
    """Median (R,) of the finite values of each (C, C); 0 if there are none."""
    flat = np.where(np.isfinite(values), values, np.nan).reshape(len(values), -1)
    some = np.isfinite(flat).any(axis=1)
    found = np.zeros(len(values))
    found[some] = np.nanmedian(flat[some], axis=1)
    return found


def _hidden_sides(seen: Seen) -> list[list[bool]]:
    """[[left, top], [right, bottom]]: whether the image border or an occluder cuts the mask there."""
    sides = []
    for mask, occluder in ((seen.mask, seen.occluder), (seen.mask.T, seen.occluder.T)):
        columns = np.flatnonzero(mask.any(axis=0))
        last = mask.shape[1] - 1
        ends = ((columns[0], columns[0] - 2), (columns[-1], columns[-1] + 2))
        sides.append(
            [
                bool(beyond <= -1 or beyond >= last + 1)
                or float(occluder[mask[:, end], np.clip(beyond, 0, last)].mean()) >= 0.3
                for end, beyond in ends
            ]
        )
    return [[sides[0][0], sides[1][0]], [sides[0][1], sides[1][1]]]

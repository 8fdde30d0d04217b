"""Pixel-accurate masks: fill holes and refine borders where depth is missing or unreliable."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import regions

from ..overlap import crop, inwards
from ..regions import proposals
from ..regions.heights import Relief
from . import colours, fattening

BAND = 12
"""Maximum distance of object pixels beyond the measured mask [px]."""
DEEP = 8
"""Measured pixels farther inside than this are kept [px]."""
SURE = 6
"""Depth cameras rarely dilate a border by more than this [px]."""
EATEN = 9
"""Depth cameras rarely erode a thin part by more than this [px]."""
NEARBY = 15
"""Distance over which colours are compared [px]."""
COLOUR_SIGMA = 6.0
"""Standard deviation of colour on one surface under one light [CIE Lab]."""
FARTHEST = 900.0
"""Cap on the squared colour difference."""
LEAST_BAY = 0.005
"""Smallest region that is added to a mask where there is no depth, as a fraction of the mask."""
ALIKE = 0.6
"""Maximum distance of a colour from the object's colours, as a fraction of its distance from the support's."""
BESIDE = 4
"""Distance from a mask at which the support's colours are sampled [px]."""
LEAST_CORE = 0.1
"""Smallest fraction of a mask whose colours stand for the object's."""
MOST_CHANGE = 0.4
"""A refined border that changes more than this fraction of the mask is rejected."""


def complete(mask: np.ndarray, others: np.ndarray, relief: Relief, pixels: np.ndarray) -> np.ndarray:
    """Fill the holes of a mask and move its border to the colour edge; (H, W) bool.

    Args:
        mask: (H, W) bool, measured pixels of the object.
        others: (H, W) bool, pixels of other objects; these are excluded.
        relief: Heights of the capture.
        pixels: (H, W, 3) uint8 photograph.
    """
    from scipy import ndimage

    mask = fattening.thinned(mask, others, relief, pixels)
    smooth = ndimage.binary_closing(np.pad(mask, 4), np.ones((3, 3), bool))[4:-4, 4:-4] & ~others
    filled = fill(bays(mask | (smooth & ~relief.valid), others, relief, pixels), others, relief)
    settled = border(filled, others, relief, pixels)
    closed = ndimage.binary_closing(np.pad(settled, 4), np.ones((3, 3), bool), iterations=2)[4:-4, 4:-4]
    return fill(settled | (closed & ~relief.valid & ~others), others, relief)


def fill(mask: np.ndarray, others: np.ndarray, relief: Relief) -> np.ndarray:
    """Fill holes over the object's footprint, such as the floor of a bowl; the opening of a handle stays empty."""
    from scipy import ndimage

    holes = ndimage.binary_fill_holes(mask) & ~mask & ~others
    labels, count = ndimage.label(holes)
    if not count:
        return mask
    within = relief.valid & _over(mask, relief)
    numbers = np.arange(1, count + 1)
    size = np.asarray(ndimage.sum(holes, labels, numbers))
    measured = np.asarray(ndimage.sum(relief.valid, labels, numbers))
    inside = np.asarray(ndimage.sum(within, labels, numbers))
    small = (measured == 0) & (size < max(30.0, 0.02 * mask.sum()))
    keep = np.concatenate([[False], small | ((measured > 0.3 * size) & (inside > 0.7 * measured))])
    return np.asarray(mask | keep[labels])


def _over(mask: np.ndarray, relief: Relief) -> np.ndarray:
    """Pixels (H, W) bool within the outline of a mask seen from above; meaningless where nothing was measured."""
    outline = regions.convex_hull(relief.points[mask & relief.raised][:, :2])
    return np.asarray(regions.inside_convex(relief.points[..., :2], outline))


def bays(mask: np.ndarray, others: np.ndarray, relief: Relief, pixels: np.ndarray) -> np.ndarray:
    """Add the region inside the convex outline of a mask in the picture that has its colours, not those of the support.

    Black and specular surfaces have no depth, and the floor of a bowl is hardly higher than the support.
    """
    from scipy import ndimage

    outline = regions.convex_hull(np.argwhere(mask).astype(np.float64))
    box = crop(mask, 2 * BAND)
    own, valid = mask[box], relief.valid[box]
    corner = [box[0].start, box[1].start]
    places = np.moveaxis(np.indices(own.shape, dtype=np.float64), 0, -1) + corner
    floor = valid & ~relief.raised[box] & ~regions.inside_convex(places, outline, BESIDE)
    if len(outline) < 3 or not floor.any():
        return mask
    inside = regions.inside_convex(places, outline)
    empty = inside & ~own & ~others[box] & (~valid | _over(mask, relief)[box])
    if empty.sum() < LEAST_BAY * own.sum():
        return mask
    lab = ndimage.uniform_filter(proposals.colour_lab(pixels[box]), size=(3, 3, 1))
    to_own, to_floor = (colours.distances(lab, empty, where) for where in (core(own), floor))
    alike = np.zeros_like(own)
    alike[empty] = to_own < ALIKE * to_floor
    labels, count = ndimage.label(ndimage.binary_opening(alike, np.ones((3, 3), bool)))
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    keep = sizes >= LEAST_BAY * own.sum()
    keep[0] = False
    found = mask.copy()
    found[box] |= keep[labels]
    return found


def core(mask: np.ndarray) -> np.ndarray:
    """Pixels (H, W) bool so far inside that their depth is the object's own; the whole mask where it is too thin."""
    inside = inwards(mask) > SURE
    return np.asarray(inside if inside.sum() >= LEAST_CORE * mask.sum() else mask)


def border(mask: np.ndarray, others: np.ndarray, relief: Relief, pixels: np.ndarray) -> np.ndarray:
    """Move the border of the mask to the colour edge between the object and its surroundings.

    Depth cameras dilate some borders and erode others by a few pixels. Each pixel near the border combines depth,
    whose weight falls towards the border, with colour, smoothed over neighbours of similar colour.
    """
    from scipy import ndimage

    box = crop(mask, 3 * BAND)
    own, foreign, measured = mask[box], others[box], relief.valid[box]
    inside, outside = ndimage.distance_transform_edt(own), ndimage.distance_transform_edt(~own)
    prior = np.where(own, 1.0 + 0.5 * inside, np.where(measured, -0.8 - 0.35 * outside, -0.5 - 0.25 * outside))
    # Borders with other objects are creases and steps, where depth is more reliable than colour.
    touching = ndimage.distance_transform_edt(~foreign) <= 4
    fixed = foreign | (outside > BAND) | (inside > DEEP) | (own & touching)
    lab = ndimage.median_filter(proposals.colour_lab(pixels[box]), size=(3, 3, 1))
    ridge = own & (inside >= ndimage.maximum_filter(inside, size=7))
    nearby = Nearby(lab, ~fixed)
    beyond = (outside > BAND) | (measured & (outside > EATEN))
    belief = np.where(own & ((inside > SURE) | ridge), 1.0, np.where(beyond, 0.0, 0.5))
    for _ in range(4):
        # The undecided band never counts as surroundings; it would confirm itself.
        surround = (beyond | (own & (belief < 0.1))) & ~foreign
        hint = nearby.evidence((belief > 0.9) & ~foreign, surround)
        belief = agree(prior + hint, lab, fixed, own)
    won = ndimage.binary_opening(np.pad(belief > 0.5, 2), np.ones((2, 2), bool))[2:-2, 2:-2] & ~foreign
    labels, count = ndimage.label(won | (own & (inside > DEEP)))
    if not count:
        return mask
    sizes = ndimage.sum(own, labels, np.arange(1, count + 1))
    result = np.zeros_like(mask)
    result[box] = np.isin(labels, 1 + np.flatnonzero(sizes > 0.02 * own.sum()))
    change = (result ^ mask).sum() / mask.sum()
    return result if change <= MOST_CHANGE else mask


class Nearby:
    """Colour differences between pixels and their neighbourhoods, cached for repeated queries."""

    def __init__(self, lab: np.ndarray, where: np.ndarray) -> None:
        self.where = where
        rows, columns = np.nonzero(where)
        reach = np.arange(-NEARBY, NEARBY + 1, 3)
        down, right = (step.reshape(-1, 1) for step in np.meshgrid(reach, reach, indexing="ij"))
        r, c = np.clip(rows + down, 0, lab.shape[0] - 1), np.clip(columns + right, 0, lab.shape[1] - 1)
        self.index = r * lab.shape[1] + c
        flat = lab.reshape(-1, 3)
        own = lab[rows, columns]
        self.difference = np.minimum(sum(np.square(flat[self.index, i] - own[:, i]) for i in range(3)), FARTHEST)

    def evidence(self, object_: np.ndarray, surround: np.ndarray) -> np.ndarray:
        """Log likelihood ratio (h, w), within +-3, of a pixel's colour: nearby object against nearby surroundings."""
        least = [
            np.where(known.ravel()[self.index], self.difference, FARTHEST).min(axis=0) for known in (object_, surround)
        ]
        ratio = np.zeros(self.where.shape)
        ratio[self.where] = np.clip((least[1] - least[0]) / (2.0 * COLOUR_SIGMA**2), -3.0, 3.0)
        return ratio


def agree(unary: np.ndarray, lab: np.ndarray, fixed: np.ndarray, start: np.ndarray, rounds: int = 12) -> np.ndarray:
    """Mean-field belief (h, w) in 0..1: log odds `unary`, smoothed over neighbours of similar colour."""
    belief = np.where(fixed, start, 1.0 / (1.0 + np.exp(-unary)))
    links = [(down, right, _likeness(lab, down, right)) for down, right in ((0, 1), (1, 0), (1, 1), (1, -1))]
    for _ in range(rounds):
        pull = np.zeros_like(unary)
        signed = 2.0 * belief - 1.0
        for down, right, weight in links:
            here, there = _pair(unary.shape, down, right)
            pull[here] += weight * signed[there]
            pull[there] += weight * signed[here]
        belief = np.where(fixed, start, 1.0 / (1.0 + np.exp(-np.clip(unary + pull, -30.0, 30.0))))
    return np.asarray(belief)


def _likeness(lab: np.ndarray, down: int, right: int) -> np.ndarray:
    here, there = _pair(lab.shape[:2], down, right)
    difference = ((lab[here] - lab[there]) ** 2).sum(axis=-1)
    return np.asarray(0.7 * np.exp(-difference / (2.0 * 8.0**2)) / np.hypot(down, right))


def _pair(shape: tuple[int, ...], down: int, right: int) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    height, width = shape[:2]
    here = (slice(0, height - down), slice(max(0, -right), width - max(0, right)))
    there = (slice(down, height), slice(max(0, right), width - max(0, -right)))
    return here, there

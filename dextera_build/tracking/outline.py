"""The outline term: the border of an object detected by colours and depth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import cameras
from dextera_build.tracking.colours import Colours, bins
from dextera_build.tracking.frame import Frame
from dextera_build.tracking.model import Cast
from dextera_build.tracking.terms import NEIGHBOURS, Placed, Rows, Spots, image_motion

BESIDE_M = 0.02
"""Depth difference behind the model at which a pixel does not show the object, and in front of it at which it hides
it [m]."""
ROUNDED_PX = 1.5
"""Standard deviation of the position of a step, in addition to that of its posterior [px], for blur and coarse rays."""
NOISE = 0.7
"""Independent noise of a position, as a fraction of the total."""
BIAS_PX = 0.2
"""Standard deviation of persistent errors, such as those of colours learned from pixels of both sides [px]."""


@dataclass(frozen=True)
class Outline:
    """Points of a model on its outline in the picture, with outward directions."""

    spots: Spots
    outward: np.ndarray  # (N, 2) unit directions in the picture, right and down
    beyond: float  # from a point to the outline [px]

    @classmethod
    def of(cls, cast: Cast, shape: tuple[int, int], most: int = 90) -> Outline:
        """Hits at the border of the rendered mask, except the border of the picture."""
        import cv2

        drawn = np.pad(cast.drawn, 1).astype(np.uint8)
        edge = (drawn - cv2.erode(drawn, np.ones((3, 3), np.uint8)))[1:-1, 1:-1] > 0
        soft = cv2.GaussianBlur(drawn.astype(np.float32), (5, 5), 1.2)
        out = np.stack([cv2.Sobel(soft, cv2.CV_32F, 1, 0), cv2.Sobel(soft, cv2.CV_32F, 0, 1)], axis=-1)[1:-1, 1:-1]
        near = 2 * cast.stride
        edge[(cast.rows < near) | (cast.rows >= shape[0] - near)] = False
        edge[:, (cast.columns < near) | (cast.columns >= shape[1] - near)] = False
        chosen = np.flatnonzero(edge & (np.abs(out).sum(axis=-1) > 1e-3))
        chosen = chosen[:: max(1, -(-len(chosen) // most))]
        way = -out.reshape(-1, 2)[chosen]
        way = way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
        return cls(Spots.at(cast, chosen), way, 0.5 * cast.stride)


@dataclass(frozen=True)
class Seen:
    """Detected outline: offsets (N,) outward and their standard deviations [px]; NaN if hidden."""

    offset: np.ndarray
    sigma: np.ndarray


def seek(frame: Frame, placed: Placed, outline: Outline, colours: Colours, reach_px: int, number: int) -> Seen:
    """Search along the normals of an outline for the step from the object to its surroundings.

    The posterior of the step's position given the colours (Stoiber et al. 2022, region modality) and the depth: pixels
    clearly behind the model are not the object; lines with something nearer, or with pixels of another object than
    `number`, are ignored.
    """
    steps = np.arange(-reach_px, reach_px + 1)
    middle = cameras.project(placed.points, frame.k) + outline.beyond * outline.outward
    at = np.round(middle[:, None] + steps[:, None] * outline.outward[:, None]).astype(np.int64)
    height, width = frame.shape
    inside = ((at >= 0) & (at < (width, height))).all(axis=(1, 2))
    column, row = at[..., 0].clip(0, width - 1), at[..., 1].clip(0, height - 1)
    evidence = colours.odds()[bins(frame.rgb[row, column])]
    z, own = frame.depth[row, column], placed.points[:, 2:3]
    evidence = np.where((z > own + BESIDE_M), -3.0, evidence)
    nearer = (z > 0) & (z < own - BESIDE_M)
    hidden = (nearer | frame.others(row, column, number)).mean(axis=1) > 0.2
    total = np.cumsum(evidence, axis=1)
    # If the step is after sample i, samples up to i are the object; neighbours are not independent.
    belief = np.exp(0.7 * (total - total.max(axis=1, keepdims=True)))
    belief /= belief.sum(axis=1, keepdims=True)
    places = steps + 0.5
    offset = belief @ places
    sigma = np.sqrt(np.maximum(belief @ np.square(places) - np.square(offset), 0.0))
    return Seen(np.where(inside & ~hidden, offset, np.nan), sigma)


def rows(frame: Frame, placed: Placed, edge: Outline, seen: Seen) -> Rows:
    """Distances of the outline along its normals [px]."""
    known = np.isfinite(seen.offset)
    jacobian = np.einsum("nk,nkj->nj", edge.outward[known], image_motion(frame, placed)[known])
    spread = np.square(seen.sigma[known]) + ROUNDED_PX**2
    off = seen.offset[known]
    # Lines to something else of the object's colour have bounded influence (Huber).
    weight = 1.0 / spread * np.minimum(1.0, 3.0 / np.maximum(np.abs(off), 1e-9))
    lasting = np.hypot(BIAS_PX, NEIGHBOURS * placed.surface_m * frame.k[0, 0] / placed.points[known, 2])
    return Rows(jacobian, off, weight, NOISE * np.sqrt(spread), lasting[:, None], placed.patch[known])

"""The sparse terms of scene alignment (the paper's Eq. 1): pixels and depths of correspondences."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dextera_build.geometry.scene_pose import ScenePose, flow, nearing

CELLS = (9, 12)
"""Rows and columns of cells for the covariance; errors within a cell are treated as fully correlated."""


@dataclass(frozen=True)
class Weights:
    """Weights of Eq. 1. The paper states none; with these, 3 mm of depth weigh as much as a pixel of 640."""

    rgb: float = 20.0  # lambda_rgb, weight of the mean squared difference of colours 0..1
    ssim: float = 1.0  # lambda_ssim, weight of 1 - SSIM
    pixel: float = 10.0  # lambda_pix, weight of the mean distance in image diagonals
    depth: float = 4.0  # lambda_dep, weight of the mean depth difference of points [m]
    surface: float = 0.0  # lambda_sur, weight of the mean difference of all depths [m]; not in Eq. 1
    soft_px: float = 1.0  # |r| is sqrt(r^2 + soft^2) - soft, which has a second derivative
    huber_m: float = 0.03  # |r| is r^2 / (2 huber) below it


@dataclass(frozen=True)
class Correspondences:
    """M: points of G matched in the photograph."""

    anchors: np.ndarray  # (M, 3) in the unit of G: the rendered pixel at its rendered depth
    pixels: np.ndarray  # (M, 2) u^R [px]
    depths: np.ndarray  # (M,) z^R [m], 0 where it is invalid

    def __getitem__(self, chosen: np.ndarray) -> Correspondences:
        """A subset."""
        return Correspondences(self.anchors[chosen], self.pixels[chosen], self.depths[chosen])

    def __len__(self) -> int:
        """Their number."""
        return len(self.anchors)


@dataclass(frozen=True)
class Terms:
    """A part of the objective at one theta."""

    value: float
    gradient: np.ndarray  # (7,)
    step: np.ndarray  # (7, 7) positive semidefinite matrix for steps: reweighted Gauss-Newton
    cells: np.ndarray  # (C, 7) gradient by cell of the picture; the sum is `gradient`
    bends: np.ndarray  # (C, 7, 7) second derivative by cell; the sum is `curvature`

    def __add__(self, other: Terms) -> Terms:
        """The sum of both."""
        return Terms(
            self.value + other.value,
            self.gradient + other.gradient,
            self.step + other.step,
            self.cells + other.cells,
            self.bends + other.bends,
        )

    @property
    def curvature(self) -> np.ndarray:
        """Second derivative (7, 7)."""
        return np.asarray(self.bends.sum(axis=0))


def sparse(
    pose: ScenePose, matches: Correspondences, k: np.ndarray, size: tuple[int, int], weights: Weights, unit: float
) -> Terms:
    """lambda_pix / |M| sum |u - u^R|_1 / d_img + lambda_dep / |M_z| sum |z - z^R|, over depths M_z that are valid.

    Args:
        pose: Theta.
        matches: M.
        k: (3, 3) intrinsics of the photograph [px].
        size: Its rows and columns [px].
        weights: See `Weights`.
        unit: Length of a unit of shift in G.
    """
    seen = pose.seen(matches.anchors)
    seen[:, 2] = np.maximum(seen[:, 2], 1e-3 * unit)
    where = cell_of(matches.pixels, size)
    pixel = seen[:, :2] / seen[:, 2:] * [k[0, 0], k[1, 1]] + [k[0, 2], k[1, 2]]
    off = (pixel - matches.pixels).reshape(-1)
    soft = np.hypot(off, weights.soft_px)
    share = weights.pixel / (max(len(matches), 1) * float(np.hypot(*size)))
    pixels = _summed(
        share * float((soft - weights.soft_px).sum()),
        flow(seen, k, unit).reshape(-1, 7),
        np.stack([off / soft, 1 / soft, weights.soft_px**2 / soft**3]) * share,
        np.repeat(where, 2),
    )
    known = matches.depths > 0
    apart = pose.scale * seen[known, 2] - matches.depths[known]
    size_m, huber = np.abs(apart), weights.huber_m
    inside = size_m < huber
    share = weights.depth / max(int(known.sum()), 1)
    depths = _summed(
        share * float(np.where(inside, apart**2 / (2 * huber), size_m - huber / 2).sum()),
        nearing(seen[known], pose.scale, unit),
        np.stack([np.clip(apart / huber, -1, 1), 1 / np.maximum(size_m, huber), inside / huber]) * share,
        where[known],
    )
    return pixels + depths


def cell_of(pixels: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Cell (N,) of each pixel (N, 2)."""
    column, row = (
        np.clip((pixels[:, axis] + 0.5) * CELLS[1 - axis] / size[1 - axis], 0, CELLS[1 - axis] - 1).astype(int)
        for axis in (0, 1)
    )
    return np.asarray(row * CELLS[1] + column)


def by_cell(values: np.ndarray, where: np.ndarray) -> np.ndarray:
    """Sums (C, ...) of values (N, ...) whose cells are `where` (N,)."""
    flat = values.reshape(len(values), int(np.prod(values.shape[1:])))
    sums = [np.bincount(where, column, CELLS[0] * CELLS[1]) for column in flat.T]
    return np.stack(sums, axis=1).reshape(-1, *values.shape[1:])


def runs(where: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
    """Each cell in `where` (N,) with the places of its values."""
    order = np.argsort(where, kind="stable")
    for some in np.split(order, np.flatnonzero(np.diff(where[order])) + 1):
        if len(some):
            yield int(where[some[0]]), some


def _summed(value: float, jacobian: np.ndarray, slopes: np.ndarray, where: np.ndarray) -> Terms:
    """Terms of residuals with (N, 7) derivatives; `slopes` (3, N) are influence, weight and second derivative."""
    each = slopes[0][:, None] * jacobian
    bends = (slopes[2][:, None] * jacobian)[:, :, None] * jacobian[:, None, :]
    step = jacobian.T @ (slopes[1][:, None] * jacobian)
    return Terms(value, each.sum(axis=0), step, by_cell(each, where), by_cell(bends, where))

"""Depth term over all valid pixels, in addition to the four terms of scene alignment (the paper's Eq. 1).

It improves the alignment if G was made from a measurement. The depth of a generated scene is at best correct in its
large features, so its weight is then 0.
"""

from __future__ import annotations

import numpy as np

from dextera_build.geometry.cameras import backproject
from dextera_build.geometry.photo_terms import Drawn, eroded
from dextera_build.geometry.scene_pose import flow, nearing
from dextera_build.geometry.scene_terms import CELLS, Terms, Weights, by_cell, cell_of, runs


def surface(
    drawn: Drawn, scale: float, measured: np.ndarray, omega: np.ndarray, k: np.ndarray, weights: Weights, unit: float
) -> Terms:
    """lambda_sur times the mean of |s_G z - z^R| over `omega` where G shows a surface, as Huber's loss.

    Args:
        drawn: G from the camera's pose.
        scale: s_G.
        measured: (H, W) z^R [m].
        omega: (H, W) usable pixels of the photograph.
        k: (3, 3) intrinsics [px].
        weights: See `Weights`.
        unit: Length of a unit of shift in G.
    """
    cells = np.zeros((CELLS[0] * CELLS[1], 7))
    inside = eroded(omega & drawn.solid, 1)
    if not weights.surface or not inside.any():
        return Terms(0.0, cells[0], np.zeros((7, 7)), cells, np.zeros((len(cells), 7, 7)))
    share = weights.surface / int(inside.sum())
    depth = np.where(drawn.solid, drawn.depth, unit)
    seen = backproject(depth, k)[inside]
    slope = (
        scale * np.stack([np.gradient(depth, axis=axis) for axis in (1, 0)], axis=-1)[inside]
    )  # along columns and rows [m/px]
    # The content of a pixel moves on and is replaced by the surface next to it.
    jacobian = nearing(seen, scale, unit) - np.einsum("na,naj->nj", slope, flow(seen, k, unit))
    apart = scale * depth[inside] - measured[inside]
    size, huber = np.abs(apart), weights.huber_m
    near = size < huber
    row, column = np.nonzero(inside)
    where = cell_of(np.stack([column, row], axis=1), omega.shape)
    value = share * float(np.where(near, apart**2 / (2 * huber), size - huber / 2).sum())
    each = share * np.clip(apart / huber, -1, 1)[:, None] * jacobian
    bends = np.zeros((len(cells), 7, 7))
    for cell, some in runs(where):
        steep = jacobian[some[near[some]]]
        bends[cell] = share / huber * steep.T @ steep
    step = share * jacobian.T @ (jacobian / np.maximum(size, huber)[:, None])
    return Terms(value, each.sum(axis=0), step, by_cell(each, where), bends)

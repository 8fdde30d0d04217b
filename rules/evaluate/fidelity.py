"""Scores of a rendered view against a real one, and their table (paper, Table III)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dextera_build.artifacts.table import Cell, Column
from dextera_build.geometry import cameras, metrics

POINTS = 4000
"""Number of points per surface in the comparison of point sets."""
COLUMNS = (
    Column(name="Pixels"),
    Column(name="RGB MAE", digits=4, better="lower"),
    Column(name="PSNR", unit="dB", digits=2, better="higher"),
    Column(name="SSIM", better="higher"),
    Column(name="Delta E76", digits=2, better="lower"),
    Column(name="Depth MAE", unit="m", digits=4, better="lower"),
    Column(name="Depth RMSE", unit="m", digits=4, better="lower"),
    Column(name="Depth median", unit="m", digits=4, better="lower"),
    Column(name="AbsRel", digits=4, better="lower"),
    Column(name="delta1", better="higher"),
    Column(name="Centroid", unit="m", digits=4, better="lower"),
    Column(name="Chamfer-L1", unit="m", digits=4, better="lower"),
    Column(name="F-score@1cm", better="higher"),
    Column(name="Coverage", better="higher"),
)
PAPER: tuple[Cell, ...] = (
    *("calibrated top camera, outside objects", 0.0583, 20.74, 0.761, 8.22),
    *(0.00516, 0.00655, None, 0.010, 1.000, 0.00100, 0.00633, 0.900, None),
)
"""Table III: the paper's scenes, rendered from the camera that they were made from; another data set."""
DEFINITIONS = (
    "RGB MAE in sRGB 0..1, Delta E76 in float Lab (D65), SSIM with an 11 px Gaussian window; black where nothing is "
    "drawn",
    f"centroid, Chamfer-L1 and F-score: the points of both depth maps, {POINTS:,} per view, in the camera frame",
    "coverage: part of the pixels in which something is drawn",
)

Score = Sequence[float | None]
"""One number per column of `COLUMNS[1:]`."""


def score(
    rgb: np.ndarray, depth: np.ndarray, true_rgb: np.ndarray, true_depth: np.ndarray, k: np.ndarray, where: np.ndarray
) -> Score:
    """Compare a rendered view with a real one.

    Args:
        rgb: (H, W, 3) uint8, rendered.
        depth: (H, W) rendered [m]; 0 without a surface.
        true_rgb: (H, W, 3) uint8.
        true_depth: (H, W) measured [m]; 0 if invalid.
        k: (3, 3) intrinsics [px].
        where: (H, W) pixels to compare.
    """
    errors = metrics.depth_errors(depth, true_depth, where)
    apart = (None,) * 5 if errors is None else (errors.mae, errors.rmse, errors.median, errors.abs_rel, errors.delta1)
    return (
        metrics.rgb_mae(rgb, true_rgb, where),
        metrics.psnr(rgb, true_rgb, where),
        metrics.ssim(rgb, true_rgb, where),
        metrics.delta_e76(rgb, true_rgb, where),
        *apart,
        *_surfaces(depth, true_depth, k, where),
        float((depth[where] > 0).mean()) if where.any() else None,
    )


def mean(scores: Sequence[Score]) -> list[Cell]:
    """Mean of each score over the views that have it."""
    return [metrics.mean_std(column)[0] for column in zip(*scores, strict=True)]


def _surfaces(found: np.ndarray, truth: np.ndarray, k: np.ndarray, where: np.ndarray) -> Score:
    both = np.flatnonzero(where & (found > 0) & (truth > 0))
    if not len(both):
        return None, None, None
    some = both[np.linspace(0, len(both) - 1, min(POINTS, len(both))).astype(np.int64)]
    one, other = (cameras.backproject(depth, k).reshape(-1, 3)[some] for depth in (found, truth))
    chamfer, f_score = metrics.chamfer_and_f(one, other, 0.01)
    return float(np.linalg.norm(one.mean(axis=0) - other.mean(axis=0))), chamfer, f_score

"""Reduction of Gaussians for a small picture: those within a fraction of a pixel are merged.

A picture 320 pixels wide of a scene measured with 1280 pixels would sort sixteen Gaussians for each of its pixels, and
show the nearest of them instead of their mean. The merged Gaussian has the mean and the covariance of its group, and
covers the same area of the picture (after Kerbl et al. 2024, "A Hierarchical 3D Gaussian Representation").
"""

from __future__ import annotations

import numpy as np

from dextera_build.gaussians import arrays as shapes
from dextera_build.gaussians.arrays import Gaussians
from dextera_build.geometry import quaternions

SMALL = 0.7
"""Gaussians with a standard deviation above this fraction of a cell are not merged."""
DEEP = 8.0
"""Depth of a cell, relative to its width; above 1, so that slanted surfaces are not split within a pixel."""
MARGIN = 0.2
"""Fraction of the picture kept beyond its border, for nearby cameras."""
MOST = 0.99
"""Maximum opacity."""
COVERING = 0.45
"""Standard deviation, in widths of a cell, at which Gaussians in all cells leave no holes."""


def merged(
    gaussians: Gaussians, k: np.ndarray, world_from_camera: np.ndarray, size: tuple[int, int], cell_px: float
) -> Gaussians:
    """The Gaussians visible to a camera, with a margin, with at most one small Gaussian per cell of the picture.

    Args:
        gaussians: In the world frame.
        k: (3, 3) intrinsics, integer pixel centres [px].
        world_from_camera: (4, 4) T_world_camera, OpenCV axes.
        size: Rows and columns [px].
        cell_px: Width of a cell of the picture [px].
    """
    places = (gaussians.means - world_from_camera[:3, 3]) @ world_from_camera[:3, :3]
    ahead = np.flatnonzero(places[:, 2] > 0)
    x, y, z = places[ahead].T
    pixels = np.stack([k[0, 0] * x / z + k[0, 2], k[1, 1] * y / z + k[1, 2]], axis=1)
    whole = np.array([size[1], size[0]])
    border = MARGIN * whole
    seen = ((pixels > -border) & (pixels < whole + border)).all(axis=1)
    chosen, pixels, z = ahead[seen], pixels[seen], z[seen]
    width = cell_px * z / k[0, 0]  # of a cell there, in the unit of the world
    small = gaussians.scales[chosen].max(axis=1) < SMALL * width
    column, row = np.floor((pixels[small] + border) / cell_px).astype(np.int64).T
    slab = np.floor(np.log(z[small]) * k[0, 0] / (DEEP * cell_px)).astype(np.int64)
    across, down = ((whole + 2 * border) / cell_px).astype(int) + 2
    cells = ((slab - slab.min(initial=0)) * down + row) * across + column
    order = np.argsort(cells, kind="stable")
    first = np.flatnonzero(np.diff(cells[order], prepend=-1))
    kept, grouped = gaussians[chosen[~small]], gaussians[chosen[small][order]]
    parents = _parents(grouped, first, world_from_camera[:3, 3], width[small][order])
    return Gaussians(*(np.concatenate([getattr(kept, name), getattr(parents, name)]) for name in _FIELDS))


_FIELDS = tuple(Gaussians.__dataclass_fields__)


def _parents(given: Gaussians, first: np.ndarray, eye: np.ndarray, width: np.ndarray) -> Gaussians:
    """One Gaussian for each group, given by its first member; `width` (N,) is that of each member's cell [m]."""
    if not len(first):
        return given

    def summed(values: np.ndarray) -> np.ndarray:
        return np.asarray(np.add.reduceat(values, first, axis=0))

    places = given.means - eye
    spread, cover = _spread_and_cover(given, places)
    area = given.opacities * cover
    covered = summed(area)
    share = area / np.repeat(covered, np.diff(first, append=len(area)))
    middle = summed(share[:, None] * places)
    spread += places[:, _ROWS] * places[:, _COLUMNS]
    moments = summed(share[:, None] * spread) - middle[:, _ROWS] * middle[:, _COLUMNS]
    variances, axes = np.linalg.eigh(moments[:, _FULL].reshape(-1, 3, 3))
    variances = np.maximum(variances, 1e-12 * variances[:, 2:])
    axes[np.linalg.det(axes) < 0, :, 0] *= -1
    # Enlarged if the group would cover less than its members did, but not into all neighbouring cells.
    facing = _facing(variances, axes, middle)
    ratio = covered / (MOST * facing)
    room = (COVERING * summed(share * width)) ** 2 / facing
    wider = np.clip(np.minimum(ratio, room), 1.0, None)
    return Gaussians(
        middle + eye,
        quaternions.from_matrices(axes),
        np.sqrt(variances * wider[:, None]),
        np.minimum(MOST * ratio / wider, MOST),
        summed(share[:, None, None] * given.harmonics),
    )


_ROWS, _COLUMNS = [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]
_FULL = [0, 1, 2, 1, 3, 4, 2, 4, 5]
"""Indices of a symmetric matrix's six numbers in it, and of its nine in these."""


def _spread_and_cover(given: Gaussians, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Covariances (N, 6), and areas (N,) covered along the rays, divided by 2 pi."""
    squares = given.scales**2
    if (squares == squares[:, :1]).all():  # isotropic Gaussians have no axes
        spread = np.zeros((len(given), 6))
        spread[:, [0, 3, 5]] = squares
        return spread, squares[:, 0]
    spread = shapes.covariances(given)[:, _ROWS, _COLUMNS]
    return spread, _facing(squares, shapes.turns(given.rotations), rays)


def _facing(variances: np.ndarray, axes: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Roots (N,) of the determinants of covariances (N, 3) about axes (N, 3, 3), projected along rays (N, 3)."""
    a, b, c = variances.T
    along = np.einsum("nij,ni->nj", axes, rays) ** 2
    areas = along[:, 0] * b * c + along[:, 1] * a * c + along[:, 2] * a * b
    return np.asarray(np.sqrt(areas / along.sum(axis=1)))

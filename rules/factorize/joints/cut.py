"""Cut a closed mesh into links: by connected components, or by the label of the nearest seen point."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.geometry import metrics

from .. import manifolds

if TYPE_CHECKING:
    from manifold3d import Manifold

CELLS = 44
"""Grid cells along the longest side of the mesh."""
SPECK = 0.003
"""Pieces of a link below this fraction of the mesh's volume are given to the other links."""
SURE = 0.9
"""Smallest fraction of a component's seen points with one label, if the component is that part."""
SAMPLES = 600
"""Points sampled on the surface of a component, to find the seen points near it."""


def solids(mesh: Mesh, points: np.ndarray, labels: np.ndarray) -> list[Manifold] | None:
    """One solid per label 0, 1, ...: components of the mesh if each has one label, else cut between the points.

    Args:
        mesh: Closed, in the frame of `points`.
        points: (N, 3) seen points [m].
        labels: (N,) their parts.

    Returns:
        The solids; None if one of them is empty.
    """
    parts = manifolds.components(mesh)
    owners = _owners(mesh, parts, points, labels)
    if owners is None:
        return _nearest(mesh, points, labels)
    faces = ([part for part, owner in zip(parts, owners, strict=True) if owner == k] for k in range(max(owners) + 1))
    return [manifolds.solid(manifolds.subset(mesh, np.sort(np.concatenate(mine)))) for mine in faces]


def _owners(mesh: Mesh, parts: list[np.ndarray], points: np.ndarray, labels: np.ndarray) -> list[int] | None:
    """The label of each connected component; None if one has points of several labels, or a label has none."""
    from scipy.spatial import KDTree

    if len(parts) <= int(labels.max()):
        return None
    pieces = [manifolds.subset(mesh, faces) for faces in parts]
    samples = [metrics.sample_surface(piece.vertices, piece.faces, SAMPLES, 0) for piece in pieces]
    nearest_one = KDTree(np.concatenate(samples)).query(points)[1] // SAMPLES
    owners = []
    for number in range(len(parts)):
        votes = np.bincount(labels[nearest_one == number], minlength=1)
        if votes.sum() == 0 or votes.max() < SURE * votes.sum():
            return None
        owners.append(int(votes.argmax()))
    return owners if set(owners) == set(range(int(labels.max()) + 1)) else None


def _nearest(mesh: Mesh, points: np.ndarray, labels: np.ndarray) -> list[Manifold] | None:
    """One solid per label 0, 1, ..., cut between the seen points; their union is the mesh. See `solids`."""
    left = manifolds.solid(mesh)
    least = SPECK * abs(float(left.volume()))
    taken = []
    for number in range(1, int(labels.max()) + 1):
        region = _region(mesh, points[labels == number], points[labels != number])
        mine = (left ^ region).decompose()
        kept = [piece for piece in mine if piece.volume() > least]
        if not kept:
            return None
        # Cut with the region rather than with other pieces, whose common faces would leave thin films.
        left = _together([left - region, *(piece for piece in mine if piece.volume() <= least)])
        taken.append(_together(kept))
    rest = [piece for piece in left.decompose() if piece.volume() > least]
    return [_together(rest), *taken] if rest else None


def _together(pieces: list[Manifold]) -> Manifold:
    import manifold3d

    return pieces[0] if len(pieces) == 1 else manifold3d.Manifold.compose(pieces)


def _region(mesh: Mesh, mine: np.ndarray, others: np.ndarray) -> Manifold:
    """The space around the mesh that is nearer to `mine` than to `others`."""
    import manifold3d
    from scipy.ndimage import gaussian_filter
    from scipy.spatial import KDTree

    low = mesh.vertices.min(axis=0).astype(np.float64)
    high = mesh.vertices.max(axis=0).astype(np.float64)
    edge = float((high - low).max()) / CELLS
    low, high = low - 2.5 * edge, high + 2.5 * edge
    counts = np.ceil((high - low) / (edge / 2)).astype(int) + 1
    axes = [low[i] + edge / 2 * np.arange(counts[i]) for i in range(3)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    nearer = np.asarray(KDTree(others).query(grid)[0]) - np.asarray(KDTree(mine).query(grid)[0])
    # Smooth over one cell, because noise of the points would make the cut ragged.
    field = gaussian_filter(nearer.reshape(counts), 1.0)
    values, start, scale = field.tolist(), low.tolist(), 2.0 / edge
    last = [int(count) - 1 for count in counts]

    def inside(x: float, y: float, z: float) -> float:
        i, j, k = (min(max(round((v - s) * scale), 0), end) for v, s, end in zip((x, y, z), start, last, strict=True))
        return float(values[i][j][k])

    return manifold3d.Manifold.level_set(inside, [*low.tolist(), *high.tolist()], edge)

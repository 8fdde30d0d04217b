"""Subsets of a sight, by mask or by label."""

from __future__ import annotations

import numpy as np

from .clouds import Cloud, Sight

LEAST_POINTS = 60
"""Minimum number of points of a part."""

APART = 3.0
"""Distance that separates two pieces, in distances of neighbouring points."""
MOST_PIECES = 3
"""Maximum number of pieces that are tried."""


def filled(here: Sight, labels: np.ndarray) -> np.ndarray:
    """Unexplained points take the label of most of their neighbours."""
    from scipy.spatial import KDTree

    known = np.flatnonzero(labels >= 0)
    if not len(known):
        return np.zeros(len(labels), int)
    nearest = KDTree(here.inner.points[known]).query(here.inner.points, k=min(15, len(known)))[1]
    votes = labels[known][nearest].reshape(len(labels), -1)
    count = np.stack([(votes == number).sum(axis=1) for number in range(labels.max() + 1)])
    return np.asarray(count.argmax(axis=0))


def inside(cloud: Cloud, mask: np.ndarray, count: int = 12) -> np.ndarray:
    """The points of a mask most of whose neighbours are in the mask, too."""
    from scipy.spatial import KDTree

    if not mask.any():
        return mask
    nearest = KDTree(cloud.points).query(cloud.points, k=min(count, len(cloud)))[1]
    return np.asarray(mask & (mask[nearest].reshape(len(mask), -1).mean(axis=1) > 0.6))


def near(cloud: Cloud, chosen: np.ndarray, reach: float = 0.01) -> np.ndarray:
    """Points within `reach` [m] of selected ones: most of a part that moved along itself appears unmoved."""
    from scipy.spatial import KDTree

    return np.asarray(np.isfinite(KDTree(cloud.points[chosen]).query(cloud.points, distance_upper_bound=reach)[0]))


def part(here: Sight, labels: np.ndarray, number: int) -> Sight:
    """One part of a sight, whose points have labels (N,)."""
    return with_borders(here, labels == number)


def with_borders(sight: Sight, chosen: np.ndarray) -> Sight:
    """Selected points, and the borders whose nearest point is selected."""
    from scipy.spatial import KDTree

    if not len(sight.border):
        return sight.some(chosen, np.zeros(0, bool))
    nearest = KDTree(sight.inner.points).query(sight.border.points)[1]
    return sight.some(chosen, chosen[nearest])


def clusters(points: np.ndarray, reach: float, least: int) -> list[np.ndarray]:
    """Indices of clusters of points (N, 3) linked within `reach` [m], with at least `least` points, largest first."""
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import KDTree

    graph = KDTree(points).sparse_distance_matrix(KDTree(points), reach)
    _, label = connected_components(graph, directed=False)
    sizes = np.bincount(label)
    return [np.flatnonzero(label == k) for k in np.argsort(-sizes, kind="stable") if sizes[k] > least]


def pieces(cloud: Cloud, mask: np.ndarray, least: int) -> list[np.ndarray]:
    """Connected pieces of a mask (N,) as masks (N,), largest first: visible parts rarely touch."""
    from scipy.spatial import KDTree

    chosen = np.flatnonzero(mask)
    spacing = float(np.median(np.asarray(KDTree(cloud.points).query(cloud.points, k=2)[0])[:, 1]))
    found = clusters(cloud.points[chosen], APART * spacing, least)[:MOST_PIECES]
    return [np.isin(np.arange(len(cloud)), chosen[mine]) for mine in found]

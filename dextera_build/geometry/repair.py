"""Closing of triangle meshes: weld vertices, drop degenerate and duplicate faces, orient faces, fill holes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

_LONGEST_EXACT = 300
"""Maximum number of edges of a hole for which the minimal surface is computed; a longer one is closed by a fan."""


@dataclass
class Triangles:
    """A mesh under repair, with the history of its faces."""

    vertices: np.ndarray  # (V, 3) float64
    faces: np.ndarray  # (F, 3) int64
    source: np.ndarray  # (F, 3) original corner 3 f + k of each corner; -1 for a new face
    counts: dict[str, int] = field(default_factory=dict)  # kind of change -> count


def repaired(vertices: np.ndarray, faces: np.ndarray, weld_m: float | None, longest_hole: int) -> Triangles:
    """The mesh after all repairs that preserve its surface; it may still be open.

    Args:
        vertices: (V, 3) [m].
        faces: (F, 3).
        weld_m: Vertices at most this far apart are merged [m]; None merges none, not even coincident ones.
        longest_hole: Maximum number of edges of a hole that is filled.
    """
    source = np.arange(3 * len(faces)).reshape(-1, 3)
    mesh = Triangles(vertices.astype(np.float64), faces.astype(np.int64), source)
    if weld_m is not None:
        _weld(mesh, weld_m)
    _drop(mesh)
    _turn(mesh)
    _fill(mesh, longest_hole)
    _turn_outwards(mesh)
    used = np.zeros(len(mesh.vertices), bool)
    used[mesh.faces] = True
    unused = len(vertices) - int(used[: len(vertices)].sum())
    mesh.counts["unused vertices removed"] = unused - mesh.counts.get("vertices welded", 0)
    mesh.vertices, mesh.faces = mesh.vertices[used], (np.cumsum(used) - 1)[mesh.faces]
    return mesh


def open_edges(faces: np.ndarray) -> int:
    """Number of edges of (F, 3) faces that are not shared by two faces in opposite directions."""
    directed = _directed(faces)
    count = int(faces.max(initial=-1)) + 1
    forward, backward = directed @ [count, 1], directed @ [1, count]
    keys, times = np.unique(np.concatenate([forward, backward]), return_counts=True)
    there, back = (np.isin(keys, side) for side in (forward, backward))
    return int((~(there & back) | (times > 2)).sum()) // 2


def _directed(faces: np.ndarray) -> np.ndarray:
    """Edges (3 F, 2) of faces: rows f, F + f and 2 F + f belong to face f."""
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


def _weld(mesh: Triangles, distance: float) -> None:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    _, first, index = np.unique(mesh.vertices, axis=0, return_index=True, return_inverse=True)
    index = first[index.reshape(-1)]
    if distance > 0 and len(first):
        pairs = cKDTree(mesh.vertices[first]).query_pairs(distance, output_type="ndarray")
        links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(first), len(first)))
        _, group = connected_components(links, directed=False)
        _, leader = np.unique(group, return_index=True)
        to = np.empty(len(mesh.vertices), np.int64)
        to[first] = first[leader[group]]
        index = to[index]
    mesh.counts["vertices welded"] = len(mesh.vertices) - len(np.unique(index))
    mesh.faces = index[mesh.faces]


def _drop(mesh: Triangles) -> None:
    """Drop faces that are degenerate by their indices, and duplicates of faces with the same corners."""
    a, b, c = mesh.faces.T
    kept = np.flatnonzero((a != b) & (b != c) & (c != a))
    mesh.counts["faces without area dropped"] = len(mesh.faces) - len(kept)
    _, first = np.unique(np.sort(mesh.faces[kept], axis=1), axis=0, return_index=True)
    mesh.counts["repeated faces dropped"] = len(kept) - len(first)
    kept = kept[np.sort(first)]
    mesh.faces, mesh.source = mesh.faces[kept], mesh.source[kept]


def _turn(mesh: Triangles) -> None:
    """Flip faces until neighbours agree, as few as possible in each connected part."""
    flip = np.zeros(len(mesh.faces), bool)
    for part, turned in _agreement(mesh.faces):
        flip[part] = turned if 2 * turned.sum() <= len(turned) else ~turned
    mesh.counts["faces turned"] = int(flip.sum())
    mesh.faces[flip] = mesh.faces[flip, ::-1]
    mesh.source[flip] = mesh.source[flip, ::-1]


def _agreement(faces: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Faces (P,) of each connected part, and whether each must be flipped (P,) to agree with the first."""
    directed = _directed(faces)
    keys = np.sort(directed, axis=1)
    order = np.lexsort(keys.T)
    same = (keys[order][1:] == keys[order][:-1]).all(axis=1)
    runs = np.flatnonzero(np.r_[True, ~same])
    pairs = (
        order[runs[np.diff(np.r_[runs, len(order)]) == 2][:, None] + [0, 1]] if len(order) else np.zeros((0, 2), int)
    )
    against = (directed[pairs[:, 0]] == directed[pairs[:, 1]]).all(axis=1)
    first, second = (pairs % max(len(faces), 1)).T
    beside: list[list[tuple[int, bool]]] = [[] for _ in faces]
    for one, other, turned in zip(first.tolist(), second.tolist(), against.tolist(), strict=True):
        beside[one].append((other, turned))
        beside[other].append((one, turned))
    state = np.full(len(faces), -1)
    for start in range(len(faces)):
        if state[start] >= 0:
            continue
        state[start], part = 0, [start]
        for face in part:  # grows
            for other, turned in beside[face]:
                if state[other] < 0:
                    state[other] = state[face] ^ turned
                    part.append(other)
        yield np.array(part), state[part] == 1


def _fill(mesh: Triangles, longest: int) -> None:
    mesh.counts |= {"holes filled": 0, "faces added": 0}
    edges = {(min(pair), max(pair)) for pair in _directed(mesh.faces).tolist()}
    for loop in _holes(mesh.faces):
        if len(loop) > longest:
            continue
        chosen = _smallest(mesh.vertices[loop], _joined(loop, edges)) if len(loop) <= _LONGEST_EXACT else None
        if chosen is not None:
            added = loop[chosen]
        else:
            middle = len(mesh.vertices)
            mesh.vertices = np.concatenate([mesh.vertices, mesh.vertices[loop].mean(axis=0, keepdims=True)])
            added = np.stack([loop, np.roll(loop, -1), np.full(len(loop), middle)], axis=1)
        edges |= {(min(pair), max(pair)) for pair in _directed(added).tolist()}
        mesh.faces = np.concatenate([mesh.faces, added])
        mesh.source = np.concatenate([mesh.source, np.full((len(added), 3), -1)])
        mesh.counts["holes filled"] += 1
        mesh.counts["faces added"] += len(added)


def _joined(loop: np.ndarray, edges: set[tuple[int, int]]) -> np.ndarray:
    """Whether an edge joins two vertices of a loop that are not neighbours in it, (n, n); it must not be used again."""
    joined = np.zeros((len(loop), len(loop)), bool)
    place = {int(vertex): number for number, vertex in enumerate(loop)}
    pairs = [(place[a], place[b]) for a, b in edges if a in place and b in place]
    if pairs:
        first, second = np.array(pairs).T
        joined[first, second] = joined[second, first] = True
    step = np.arange(len(loop))
    joined[step, (step + 1) % len(loop)] = joined[(step + 1) % len(loop), step] = False
    return joined


def _holes(faces: np.ndarray) -> Iterator[np.ndarray]:
    """Closed loops of vertices around holes, in the direction of the faces that fill them."""
    directed = {(a, b) for a, b in _directed(faces).tolist()}
    following: dict[int, list[int]] = {}
    for a, b in sorted(directed):
        if (b, a) not in directed:
            following.setdefault(b, []).append(a)
    while following:
        start = min(following)
        walk, place = [start], {start: 0}
        while walk and walk[-1] in following:
            here = walk[-1]
            onward = following[here].pop()
            if not following[here]:
                del following[here]
            if onward in place:  # where a loop touches itself, it is split
                loop = walk[place[onward] :]
                if len(loop) > 2:
                    yield np.array(loop)
                for vertex in loop[1:]:
                    del place[vertex]
                walk = walk[: place[onward] + 1]
            else:
                place[onward] = len(walk)
                walk.append(onward)


def _smallest(points: np.ndarray, forbidden: np.ndarray) -> np.ndarray | None:
    """Triangles (n - 2, 3) that span a polygon (n, 3) with the least area (Barequet and Sharir 1995).

    None if every such surface uses one of the `forbidden` diagonals, (n, n).
    """
    count = len(points)
    cost, split = np.where(forbidden, np.inf, 0.0), np.zeros((count, count), np.int64)
    for length in range(2, count):
        for first in range(count - length):
            last = first + length
            between = np.arange(first + 1, last)
            cross = np.cross(points[between] - points[first], points[last] - points[first])
            total = cost[first, between] + cost[between, last] + np.linalg.norm(cross, axis=1)
            best = int(np.argmin(total))
            cost[first, last], split[first, last] = cost[first, last] + total[best], between[best]
    if not np.isfinite(cost[0, -1]):
        return None
    found, waiting = [], [(0, count - 1)]
    while waiting:
        first, last = waiting.pop()
        if last - first > 1:
            middle = int(split[first, last])
            found.append((first, middle, last))
            waiting += [(first, middle), (middle, last)]
    return np.array(found)


def _turn_outwards(mesh: Triangles) -> None:
    """Flip all faces if the enclosed volume is negative."""
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    if open_edges(mesh.faces) == 0 and float((np.cross(a, b) * c).sum()) < 0:
        mesh.faces, mesh.source = mesh.faces[:, ::-1].copy(), mesh.source[:, ::-1].copy()
        mesh.counts["faces turned"] += len(mesh.faces)

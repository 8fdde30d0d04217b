"""Resize objects of a compiled model: all lengths of an object by one factor, about its own origin."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

FREE, BALL, SLIDE, HINGE = 0, 1, 2, 3
"""`mjtJoint`; the limits of a slide are lengths."""
TURNS = {FREE: (3, 4, 5), BALL: (0, 1, 2), SLIDE: (), HINGE: (0,)}
"""Degrees of freedom of a joint that are rotations."""
MESH = 7
"""`mjtGeom.mjGEOM_MESH`."""


class Sizes:
    """Keeps a model's original lengths and applies factors to them, never to earlier factors' results.

    Masses and inertias are not changed, see `sim.runtime.dynamics`; collision, bounding volumes and joints are.

    Args:
        objects: Names of root bodies.
        model: Their unmodified compiled model; `put` modifies it.
    """

    def __init__(self, objects: Iterable[str], model: Any) -> None:
        self._now = dict.fromkeys(objects, 1.0)
        self._parts = {name: _lengths(model, int(model.body(name).id)) for name in self._now}
        self._model = model

    def put(self, factors: Mapping[str, float]) -> None:
        """Scale every object by this factor of its original size; default 1."""
        for name, before in self._now.items():
            factor = factors.get(name, 1.0)
            if factor == before:
                continue
            for field, rows, original in self._parts[name]:
                getattr(self._model, field)[rows] = original * factor
            self._now[name] = factor


_Part = tuple[str, slice | np.ndarray, np.ndarray]
"""Field of the model, its rows, and their original values."""


def _lengths(model: Any, root: int) -> list[_Part]:
    """The parts of a model that are lengths of the bodies below `root`, in their own frames."""
    bodies = np.flatnonzero(model.body_rootid == root)
    geoms = np.flatnonzero(np.isin(model.geom_bodyid, bodies))
    joints = np.flatnonzero(np.isin(model.jnt_bodyid, bodies))
    sites = np.flatnonzero(np.isin(model.site_bodyid, bodies))
    meshes = np.unique(model.geom_dataid[geoms[model.geom_type[geoms] == MESH]])
    boxes = [
        *_spans(model.body_bvhadr[bodies], model.body_bvhnum[bodies]),
        *_spans(model.mesh_bvhadr[meshes], model.mesh_bvhnum[meshes]),
    ]
    rows = {
        # The root's own position is that of its free joint.
        "body_pos": bodies[bodies != root],
        "body_ipos": bodies,
        "geom_pos": geoms,
        "geom_size": geoms,
        "geom_rbound": geoms,
        "geom_aabb": geoms,
        "jnt_pos": joints,
        "jnt_range": joints[model.jnt_type[joints] == SLIDE],
        "dof_length": np.array([model.jnt_dofadr[j] + k for j in joints for k in TURNS[int(model.jnt_type[j])]], int),
        "site_pos": sites,
        "site_size": sites,
        "mesh_vert": np.array(_spans(model.mesh_vertadr[meshes], model.mesh_vertnum[meshes]), int),
        "bvh_aabb": np.array(boxes, int),
    }
    return [(field, _run(at), getattr(model, field)[at].copy()) for field, at in rows.items() if len(at)]


def _run(rows: np.ndarray) -> slice | np.ndarray:
    """Consecutive rows as a slice, which NumPy writes ten times as fast."""
    first = int(rows[0])
    return slice(first, first + len(rows)) if (rows == np.arange(first, first + len(rows))).all() else rows


def _spans(starts: np.ndarray, counts: np.ndarray) -> list[int]:
    return [row for start, count in zip(starts, counts, strict=True) for row in range(start, start + count)]

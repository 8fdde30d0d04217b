"""Start poses of falling objects: apart, side by side, or above one another."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dextera_build.artifacts.scenes.draw import Contact
from dextera_build.artifacts.scenes.world import Thing
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import transforms

UPRIGHT = 0.7
"""Fraction of the objects that start upright; the others are rotated at random, and lie or lean after the fall."""
GAP_M = 0.02
"""Gap between separate objects, and between an object and those below it [m]."""
TOUCHING_M = 0.001
"""Gap between adjacent objects before they fall [m]."""
TRIES = 60
"""Number of positions tried per object."""
SPREAD_M = 0.085
"""Standard deviation of positions about the centre of the table for one object; it grows with the root of the count
[m]."""


def scattered(
    things: dict[str, Thing], contact: Contact, low: np.ndarray, high: np.ndarray, rng: np.random.Generator
) -> dict[str, Thing]:
    """Objects with start poses above a table with corners `low`, `high` (2,) [m], if there is a free position."""
    placed: dict[str, Thing] = {}
    taken: list[np.ndarray] = []
    top = GAP_M
    for name, thing in things.items():
        turn = _turn(rng)
        corners = thing.surface.vertices.astype(np.float64) @ turn.T
        outline = _outline(corners)
        spot = _spot(outline, taken, contact, len(things), (low, high), rng)
        if spot is None:
            continue
        height = (top if contact == "piled" else GAP_M / 4) - float(corners[:, 2].min())
        taken.append(outline + spot)
        # In a pile, each object starts above all earlier ones.
        top += float(np.ptp(corners[:, 2])) + GAP_M
        pose = transforms.rigid(turn, np.array([*spot, height]))
        placed[name] = thing.model_copy(update={"pose": Pose(parent="reference", child="thing", matrix=pose)})
    return placed


def _turn(rng: np.random.Generator) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    if rng.uniform() < UPRIGHT:
        return np.asarray(Rotation.from_euler("z", rng.uniform(0, 2 * np.pi)).as_matrix())
    return np.asarray(Rotation.random(random_state=int(rng.integers(2**31))).as_matrix())


def _outline(corners: np.ndarray) -> np.ndarray:
    """Convex outline (P, 2) of an object from above."""
    from scipy.spatial import ConvexHull

    flat = corners[:, :2]
    return np.asarray(flat[ConvexHull(flat).vertices])


def _spot(
    outline: np.ndarray,
    taken: list[np.ndarray],
    contact: Contact,
    count: int,
    bounds: tuple[np.ndarray, np.ndarray],
    rng: np.random.Generator,
) -> np.ndarray | None:
    middle = (bounds[0] + bounds[1]) / 2
    spread = SPREAD_M * np.sqrt(count) * (0.35 if contact == "piled" else 1.0)

    def is_free(spot: np.ndarray, gap: float) -> bool:
        moved = outline + spot
        inside = (moved.min(axis=0) > bounds[0] + 0.03).all() and (moved.max(axis=0) < bounds[1] - 0.03).all()
        return bool(inside) and all(apart(moved, other, gap) for other in taken)

    for _ in range(TRIES):
        spot: np.ndarray = middle + rng.normal(0.0, spread, 2)
        if contact == "piled":
            return np.asarray(np.clip(spot, bounds[0] + 0.15, bounds[1] - 0.15))
        if contact == "touching" and taken:
            anchor = taken[int(rng.integers(len(taken)))].mean(axis=0)
            spot = _closest(anchor, rng.uniform(0, 2 * np.pi), lambda place: is_free(place, TOUCHING_M))
        if is_free(spot, TOUCHING_M if contact == "touching" else GAP_M):
            return spot
    return None


def _closest(anchor: np.ndarray, angle: float, is_free: Callable[[np.ndarray], bool]) -> np.ndarray:
    """The free position nearest to `anchor` along a direction, within a metre, to a tenth of a millimetre."""
    ahead = np.array([np.cos(angle), np.sin(angle)])
    near, far = 0.0, 1.0
    for distance in np.arange(0.02, 1.0, 0.02):
        if is_free(anchor + distance * ahead):
            far = float(distance)
            break
        near = float(distance)
    while far - near > 1e-4:
        middle = (near + far) / 2
        near, far = (near, middle) if is_free(anchor + middle * ahead) else (middle, far)
    return np.asarray(anchor + far * ahead)


def apart(one: np.ndarray, other: np.ndarray, gap: float) -> bool:
    """Whether a line parallel to an edge separates two convex outlines by more than `gap` [m]."""
    for shape in (one, other):
        edges = np.roll(shape, -1, axis=0) - shape
        normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1) / np.linalg.norm(edges, axis=1, keepdims=True)
        first, second = one @ normals.T, other @ normals.T
        if (np.maximum(second.min(axis=0) - first.max(axis=0), first.min(axis=0) - second.max(axis=0)) > gap).any():
            return True
    return False

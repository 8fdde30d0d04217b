"""Cylinders through the seen points of a thing, upright or lying: what a can is, however it lies or is hidden."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

NEAR, NEAR_M = 0.08, 0.003
"""Largest distance of a point on the surface from it: this part of the radius, and at least this [m]."""
SHARE = 0.95
"""Smallest fraction of the points on the surface of a cylinder."""
BENT, ARC_DEG = 0.5, 70.0
"""Smallest fraction of the points on the wall of a lying cylinder, and smallest angle that a wall spans."""
BELOW_M, SLIMMEST = 0.008, 0.7
"""Largest depth of a lying cylinder below the support [m], and its smallest length over its diameter: a disc on its
edge rolls or falls."""
ANGLES, FINER = 36, 3
"""Directions of a lying axis that are tried, and halvings of their distance about the best one."""
LID = 0.4
"""Smallest part of the lid that is seen, of what its picture would show."""
RIM_M, DEEP_M = 0.006, 0.012
"""Depth below the highest points that may still be rim, and from which a surface is that of a cavity [m]."""
PARTS, EVERYWHERE = 6, 0.85
"""Parts of the length of a lying cylinder, and smallest fraction of points on its surface in each."""
FLAT = 0.1
"""Largest depth of the rim of a lid of any form, as a part of the height."""
CAVITY = 0.05
"""Largest fraction of points in a cavity."""
FEWEST, MOST = 40, 1500
"""Fewest points of a wall, and number of points that forms are fitted to."""
RADII_M = (0.008, 0.15)
"""Smallest and largest radius [m]."""
TRIES, ROUNDS = 60, 6
"""Circles through three points that are tried, and rounds of fits to the points near the best one."""


@dataclass(frozen=True)
class Cylinder:
    """A cylinder through points."""

    diameter_m: float
    length_m: float
    """Its seen extent along its axis [m]."""
    lies: bool
    share: float
    """Fraction of the points on its surface."""


def cylinder(points: np.ndarray, eye: np.ndarray) -> Cylinder | None:
    """The upright or lying cylinder on which nearly all points (N, 3) are, seen from `eye` (3,); z up, 0: support."""
    if len(points) < FEWEST:
        return None
    points = thinned(points)
    stands = upright(points, eye)
    if stands is not None and stands.share >= SHARE:
        return stands
    lies = lying(points, eye)
    return lies if lies is not None and lies.share >= SHARE else None


def thinned(points: np.ndarray) -> np.ndarray:
    """At most `MOST` of points (N, 3)."""
    return np.asarray(points[np.linspace(0, len(points) - 1, min(MOST, len(points))).astype(int)])


def near(radius: float) -> float:
    """Largest distance of a point on the surface of a cylinder of a radius from it [m]."""
    return max(NEAR_M, NEAR * radius)


def lying(points: np.ndarray, eye: np.ndarray) -> Cylinder | None:
    """The cylinder with a level axis on which most points (N, 3) are."""
    step = np.pi / ANGLES
    tried = [(angle, _along(points, eye, angle)) for angle in np.arange(ANGLES) * step]
    for _ in range(FINER):
        told = [(one.share, angle) for angle, one in tried if one is not None]
        if not told:
            return None
        step, middle = step / 2.0, max(told)[1]
        tried += [(angle, _along(points, eye, angle)) for angle in (middle - step, middle + step)]
    return max((one for _, one in tried if one is not None), key=lambda one: one.share)


def _along(points: np.ndarray, eye: np.ndarray, angle: float) -> Cylinder | None:
    """The same with its axis at an angle [rad] from x."""
    along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    flat = np.column_stack([points[:, :2] @ across, points[:, 2]])
    fitted = _circle(flat, np.array([eye[:2] @ across, eye[2]]), TRIES // 5)
    if fitted is None:
        return None
    centre, radius = fitted
    off, reach = np.linalg.norm(flat - centre, axis=1) - radius, points[:, :2] @ along
    low, high = np.quantile(reach, [0.01, 0.99])
    wall = np.abs(off) < near(radius)
    end = (off < 0.0) & (np.minimum(reach - low, high - reach) < near(radius))
    if centre[1] - radius < -BELOW_M or high - low < SLIMMEST * 2.0 * radius:
        return None
    if wall.mean() < BENT or _arc(flat[wall] - centre, np.array([0.0, 1.0])) < ARC_DEG:
        return None
    # The neck of a bottle is one part of its length, so every part counts.
    own = np.clip(PARTS * (reach - low) / (high - low), 0, PARTS - 1).astype(int)
    parts = [(wall | end)[own == part] for part in range(PARTS)]
    if min(float(part.mean()) for part in parts if len(part) >= FEWEST // PARTS) < EVERYWHERE:
        return None
    return Cylinder(2.0 * radius, float(high - low), True, float((wall | end).mean()))


def upright(points: np.ndarray, eye: np.ndarray) -> Cylinder | None:
    """The cylinder with a vertical axis and a lid on which most points (N, 3) are."""
    low, top = (float(value) for value in np.quantile(points[:, 2], [0.02, 0.99]))
    side = points[(points[:, 2] < top - RIM_M) & (points[:, 2] > low)]
    fitted = _circle(side[:, :2], eye[:2], TRIES) if len(side) >= FEWEST else None
    if fitted is None:
        return None
    centre, radius = fitted
    off, rim = np.linalg.norm(points[:, :2] - centre, axis=1) - radius, top - points[:, 2]
    wall, lid = np.abs(off) < near(radius), (off < near(radius)) & (rim < DEEP_M)
    seen = side[np.abs(np.linalg.norm(side[:, :2] - centre, axis=1) - radius) < near(radius)][:, :2] - centre
    if len(seen) < FEWEST or _arc(seen, eye[:2] - centre) < ARC_DEG:
        return None
    if ((off < -near(radius)) & (rim >= DEEP_M)).mean() > CAVITY:
        return None
    lifted = max(float(eye[2] - top), 0.0) / max(float(np.linalg.norm(eye[:2] - centre)), 1e-9)
    shown = np.pi / 2 * lifted * radius
    if (lid & ~wall).mean() < LID * shown / (shown + top - low):
        return None
    return Cylinder(2.0 * radius, top - low, False, float((lid | wall).mean()))


def is_prism(points: np.ndarray, eye: np.ndarray) -> bool:
    """Whether nearly all points (N, 3) are on a level lid or on upright walls below its outline, of any convex form."""
    import cv2

    points = thinned(points)
    top, low = float(np.quantile(points[:, 2], 0.99)), float(np.quantile(points[:, 2], 0.02))
    hull = cv2.convexHull(points[:, :2].astype(np.float32))[:, 0].astype(np.float64)
    along = np.roll(hull, -1, axis=0) - hull
    across = np.column_stack([-along[:, 1], along[:, 0]]) / np.maximum(np.linalg.norm(along, axis=1), 1e-9)[:, None]
    inside = np.abs(((points[:, None, :2] - hull) * across).sum(axis=-1))
    wide = float(np.sqrt(cv2.contourArea(hull.astype(np.float32))))
    # Noise moves the hull outwards, and the points of a wall are about its middle.
    wall, lid = inside.min(axis=1) < 2.0 * near(wide / 2.0), points[:, 2] > top - min(RIM_M, FLAT * (top - low))
    lifted = max(float(eye[2] - top), 0.0) / max(float(np.linalg.norm(eye[:2] - hull.mean(axis=0))), 1e-9)
    shown = np.pi / 4 * lifted * wide
    return bool((wall | lid).mean() > SHARE and (lid & ~wall).mean() > LID * shown / (shown + top - low))


def _arc(points: np.ndarray, ahead: np.ndarray) -> float:
    """Angle that points (N, 2) span about the origin, on both sides of a direction (2,) [deg]."""
    angles = np.arctan2(points @ np.array([-ahead[1], ahead[0]]), points @ ahead)
    return float(np.degrees(np.ptp(np.quantile(angles, [0.02, 0.98]))))


def _circle(points: np.ndarray, eye: np.ndarray, tries: int) -> tuple[np.ndarray, float] | None:
    """Centre (2,) and radius [m] of the circle near most points (N, 2), which show its side towards `eye` (2,)."""
    rng = np.random.default_rng(0)
    best: tuple[int, np.ndarray, float] | None = None
    middle = np.median(points, axis=0)
    for _ in range(tries):
        fitted = _through(points[rng.choice(len(points), 3, replace=False)])
        if fitted is None or not RADII_M[0] < fitted[1] < RADII_M[1]:
            continue
        if np.linalg.norm(eye - fitted[0]) > np.linalg.norm(eye - middle):
            count = int((np.abs(np.linalg.norm(points - fitted[0], axis=1) - fitted[1]) < near(fitted[1])).sum())
            best = (count, *fitted) if best is None or count > best[0] else best
    if best is None:
        return None
    _, centre, radius = best
    for _ in range(ROUNDS):
        refined = _through(points[np.abs(np.linalg.norm(points - centre, axis=1) - radius) < near(radius)])
        if refined is None:
            break
        centre, radius = refined
    return centre, radius


def _through(points: np.ndarray) -> tuple[np.ndarray, float] | None:
    """Centre (2,) and radius of the algebraic circle through points (N, 2); None if they are on a line."""
    if len(points) < 3:
        return None
    middle = points.mean(axis=0)
    own = points - middle
    solution, _, rank, _ = np.linalg.lstsq(np.c_[2.0 * own, np.ones(len(own))], (own**2).sum(axis=1), rcond=None)
    square = float(solution[2] + solution[:2] @ solution[:2])
    return (solution[:2] + middle, square**0.5) if rank == 3 and square > 0.0 else None

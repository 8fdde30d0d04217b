"""Two thin slabs that meet at a level crease: an open laptop, a standing open book, a hinged lid."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import planes, solids, transforms
from dextera_build.geometry.solids import Solid

from ..evidence import Evidence
from ..refine import Model
from .box import LARGEST_M, upright

THIN_M = 0.006
"""Thickness of a slab with an unseen edge [m]."""
THINNEST_M = 0.003
"""Minimum thickness of a slab [m]."""
BASE_M = 0.015
"""Thickness of an unseen base [m]."""
OVERHANG = -0.06
"""Largest z component of the unit normal of an overhanging face."""


def panels(evidence: Evidence) -> Model | None:
    """x, y, yaw, width, base depth, base thickness, lid length, lid thickness, opening angle; None without two planes.

    In the body's frame x runs along the crease, the base reaches from the crease towards -y, and the lid is at
    its +y end; at angle pi the lid is flat.
    """
    start = _start(evidence)
    if start is None:
        start = _from_behind(evidence)
    if start is None:
        return None
    inf = np.inf
    return Model(
        name="panels",
        build=panels_solid,
        starts=[start],
        steps=np.array([0.003, 0.003, 0.015, 0.003, 0.003, 0.002, 0.003, 0.002, 0.02]),
        lower=np.array([-inf, -inf, -inf, 0.02, 0.02, THINNEST_M, 0.02, THINNEST_M, 0.15]),
        upper=np.array([inf, inf, inf, LARGEST_M, LARGEST_M, 0.08, LARGEST_M, 0.05, np.pi]),
        expected=start,
        spread=np.array([inf, inf, inf, 0.1, 0.1, 0.005, 0.1, 0.002, 0.5]),
        cost=0.01,
    )


def panels_solid(p: np.ndarray) -> Solid:
    """Both slabs in the world frame, two components."""
    return solids.join(slabs(p)).moved(upright(p[0], p[1], p[2]))


def slabs(p: np.ndarray) -> list[Solid]:
    """Base and lid in the body's frame, base on z = 0."""
    width, depth, thick, length, lid, angle = p[3:9]
    base = solids.box((width, depth, thick), (0.0, 0.0, thick / 2))
    # The lid's inner face runs through the crease; its thickness is on the outer side, clear of the base.
    along = np.array([0.0, -np.cos(angle), np.sin(angle)])
    outward = np.array([0.0, np.sin(angle), np.cos(angle)])
    pose = transforms.rigid(np.stack([[1.0, 0.0, 0.0], outward, along], axis=-1), np.array([0.0, depth / 2, thick]))
    slab = solids.box((width, lid, length), (0.0, lid / 2, length / 2))
    return [base, slab.moved(pose)]


def _from_behind(evidence: Evidence) -> np.ndarray | None:
    """A start if the camera sees one overhanging plane: it cannot stand alone, so it is a lid seen from behind."""
    points = evidence.points
    found = planes.largest(points, evidence.point_sigma, np.random.default_rng(0))
    if found is None:
        return None
    plane, on_plane = found
    normal, offset = plane if planes.distance(plane, evidence.eye) > 0 else (-plane[0], -plane[1])
    lid = points[on_plane]
    level = float(np.linalg.norm(normal[:2]))
    if len(lid) < 0.6 * len(points) or not -0.8 < normal[2] < OVERHANG or level < 1e-6:
        return None
    across = normal[:2] / level
    crease = np.array([across[1], -across[0]])
    left, right = np.quantile(lid[:, :2] @ crease, [0.005, 0.995])
    length = (float(np.quantile(lid[:, 2], 0.995)) - BASE_M) / level
    edge = (-offset - BASE_M * normal[2]) / level - THIN_M / level
    if length < 0.03 or right - left < 0.03:
        return None
    centre = crease * (left + right) / 2 + across * (edge - length / 2)
    yaw, angle = float(np.arctan2(crease[1], crease[0])), float(np.arctan2(level, normal[2]))
    return np.array([*centre, yaw, right - left, length, BASE_M, length, THIN_M, angle])


def _start(evidence: Evidence) -> np.ndarray | None:
    found = _two_planes(evidence)
    if found is None:
        return None
    (base_normal, base), (lid_normal, lid) = found
    crease = np.cross(base_normal, lid_normal)
    crease = np.array([crease[0], crease[1], 0.0]) / max(float(np.linalg.norm(crease[:2])), 1e-9)
    # y points from the base over the crease; the lid's plane meets the base's height at the crease.
    level = float(np.median(base[:, 2]))
    across = np.array([-crease[1], crease[0]])
    tilt = float(lid_normal[:2] @ across)
    middle = lid.mean(axis=0)
    edge = float(middle[:2] @ across) + (middle[2] - level) * lid_normal[2] / tilt if abs(tilt) > 0.2 else None
    if edge is None:
        return None
    if float(np.median(base[:, :2] @ across)) > edge:
        crease, across, edge = -crease, -across, -edge
    # Along the lid, sin(angle) is its rise and -cos(angle) its way back, per unit length.
    back = float((lid[:, :2] @ across - edge) @ (lid[:, 2] - level)) / float(((lid[:, 2] - level) ** 2).sum() + 1e-12)
    angle = float(np.arctan2(1.0, -back))
    reach = (lid[:, :2] @ across - edge) * -np.cos(angle) + (lid[:, 2] - level) * np.sin(angle)
    sides = np.concatenate([base, lid])[:, :2] @ crease[:2]
    left, right = np.quantile(sides, [0.005, 0.995])
    front = float(np.quantile(base[:, :2] @ across, 0.005))
    depth, length = edge - front, float(np.quantile(reach, 0.995))
    if depth < 0.03 or length < 0.03 or right - left < 0.03:
        return None
    centre = crease[:2] * (left + right) / 2 + across * (edge + front) / 2
    yaw = float(np.arctan2(crease[1], crease[0]))
    return np.array([*centre, yaw, right - left, depth, max(level, THINNEST_M), length, THIN_M, angle])


def _two_planes(evidence: Evidence) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]] | None:
    """(normal, points) of a level plane and of one rising from it, or None."""
    step = max(1, len(evidence.points) // 4000)
    points, normals, sigma = (each[::step] for each in (evidence.points, evidence.normals, evidence.point_sigma))
    level = normals[:, 2] > 0.93
    if level.mean() < 0.1:
        return None
    height = float(np.median(points[level, 2]))
    base = level & (np.abs(points[:, 2] - height) < 0.012)
    rest = ~level & (points[:, 2] > height + 0.008)
    if rest.sum() < 100 or base.sum() < 100:
        return None
    found = planes.largest(points[rest], sigma[rest], np.random.default_rng(0))
    if found is None:
        return None
    plane, _ = found
    lid = np.abs(planes.distance(plane, points)) < 3.0 * sigma
    lid &= points[:, 2] > height + 0.008
    if lid.sum() < 0.1 * len(points) or (lid | base).mean() < 0.6:
        return None
    return (np.array([0.0, 0.0, 1.0]), points[base]), (plane[0], points[lid])

"""Place a model of unknown scale on the support so that its silhouette fits the mask; without measurements."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.objects.view import Seen
from dextera_build.geometry import cameras, lie, transforms
from dextera_build.geometry.registration import ScaledPose

from .model_view import ModelView

TURNS = 24
"""Number of rotations about the vertical that are tried."""
FINALISTS = 4
"""Number of rotations that are refined."""
_POINTS = 600
"""Number of vertices whose projections give a silhouette's extent."""
_COARSE = 3000
"""Rays per render during refinement."""
_HIDDEN = 0.1
"""Weight of a side of the mask at which an occluder may hide the object."""


def search(model: ModelView, vertices: np.ndarray, faces: np.ndarray, seen: Seen) -> ScaledPose:
    """The standing placement with the best mask IoU over all rotations about the vertical.

    Position and scale of each rotation follow from the extent of the mask; the best ones are refined by the render
    (Nelder and Mead 1965).

    Args:
        model: The model in front of the camera, at full resolution.
        vertices: (V, 3) in model units, z up as the object stands.
        faces: (F, 3) int.
        seen: The view, whose camera pose is that over the support z = 0.
    """
    coarse = ModelView(vertices, faces, seen, pixels=_COARSE)
    points = vertices[:: max(1, len(vertices) // _POINTS)]
    starts = [_fitted(points, vertices, seen, turn) for turn in np.arange(TURNS) * 2.0 * np.pi / TURNS]
    ranked = sorted(starts, key=lambda four: coarse.score(_standing(vertices, four)).cost)
    refined = [_refined(coarse, vertices, four) for four in ranked[:FINALISTS]]
    ends = [_standing(vertices, four) for four in (*refined, ranked[0])]
    return min(ends, key=lambda placed: model.score(placed).cost)


def _standing(vertices: np.ndarray, four: np.ndarray) -> ScaledPose:
    """The placement with x, y, log scale and yaw [rad]; its lowest point is on the support."""
    x, y, size, turn = four
    scale = float(np.exp(size))
    rotation = lie.rotation(np.array([0.0, 0.0, turn]))
    return ScaledPose(scale, transforms.rigid(rotation, np.array([x, y, -scale * float(vertices[:, 2].min())])))


def _fitted(points: np.ndarray, vertices: np.ndarray, seen: Seen, turn: float) -> np.ndarray:
    """x, y, log scale and yaw at which the projection has the extent of the mask."""
    from scipy import optimize

    wanted, weight = _extent(seen)
    k, camera_from_world = seen.camera.matrix(), transforms.invert(seen.world_from_camera)

    def off(three: np.ndarray) -> np.ndarray:
        placed = _standing(vertices, np.append(three, turn))
        found = cameras.extent(placed.apply(points), camera_from_world, k)
        return np.asarray(weight * (found - wanted) / (wanted[2:] - wanted[:2]).max())

    spot, distance = _foot(wanted, seen)
    size = float(np.ptp(points, axis=0).max())
    start = np.array([*spot, np.log(max((wanted[2:] - wanted[:2]).max() * distance / seen.camera.fx / size, 1e-9))])
    unit = max(float(seen.world_from_camera[2, 3]), 1e-9)
    found = optimize.least_squares(off, start, x_scale=[unit, unit, 1.0], loss="soft_l1", max_nfev=60)
    return np.append(found.x, turn)


def _extent(seen: Seen) -> tuple[np.ndarray, np.ndarray]:
    """left, top, right, bottom of the mask in pixels of the crop, and the weight of each side."""
    rows, columns = np.nonzero(seen.mask)
    wanted = np.array([columns.min(), rows.min(), columns.max(), rows.max()], np.float64)
    beyond = (
        seen.occluder[:, max(0, int(wanted[0]) - 2)],
        seen.occluder[max(0, int(wanted[1]) - 2)],
        seen.occluder[:, min(seen.mask.shape[1] - 1, int(wanted[2]) + 2)],
        seen.occluder[min(seen.mask.shape[0] - 1, int(wanted[3]) + 2)],
    )
    return wanted, np.array([_HIDDEN if side.any() else 1.0 for side in beyond])


def _foot(extent: np.ndarray, seen: Seen) -> tuple[np.ndarray, float]:
    """Intersection of the ray through the lowest middle of the mask with the support, and its depth."""
    k, pose = seen.camera.matrix(), seen.world_from_camera
    pixel = np.array([(extent[0] + extent[2]) / 2.0, extent[3], 1.0])
    ray = pose[:3, :3] @ np.linalg.solve(k, pixel)
    depth = float(pose[2, 3] / max(-ray[2], 1e-3))
    return (pose[:3, 3] + depth * ray)[:2], depth


def _refined(coarse: ModelView, vertices: np.ndarray, four: np.ndarray) -> np.ndarray:
    from scipy import optimize

    def cost(at: np.ndarray) -> float:
        return coarse.score(_standing(vertices, at)).cost

    size = float(np.exp(four[2]) * np.ptp(vertices, axis=0).max())
    corners = np.concatenate([[four], four + np.diag([0.03 * size, 0.03 * size, 0.05, 0.15])])
    limits = {"initial_simplex": corners, "maxfev": 160, "xatol": 1e-4, "fatol": 1e-4}
    found = optimize.minimize(cost, four, method="Nelder-Mead", options=limits)  # type: ignore[call-overload]
    return np.asarray(found.x)

"""background.paths without a model: small arcs around the photograph's look-at point."""

from __future__ import annotations

import numpy as np
from pydantic import Field, NonNegativeFloat

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.cameras.panorama import Panorama
from dextera_build.artifacts.objects.object import Support
from dextera_build.artifacts.scenes.scene import Background
from dextera_build.artifacts.spatial.trajectory import Trajectory
from dextera_build.geometry import metrics, poses, transforms
from dextera_build.geometry.lie import rotation
from dextera_build.rule import Backend, Context, Options

BACKEND = Backend(
    summary="arcs around the point that the photograph's camera looks at", profiles=("cpu", "stub"), packages=("numpy",)
)

SAMPLES = 20_000
"""Number of points on the measured surface that cameras avoid."""


class OrbitOptions(Options):
    """Options of backend `orbit` of background.paths."""

    across_deg: float = Field(12.0, gt=0.0, le=60.0)
    """Largest angle to the left and to the right [deg]."""
    upwards_deg: float = Field(8.0, gt=0.0, le=60.0)
    """Largest angle up and down [deg]."""
    cameras: int = Field(7, ge=3, le=101)
    """Number of cameras on each arc, if all of it is clear."""
    clearance_m: NonNegativeFloat = 0.15
    """Minimum distance of a camera from the measured surface and from the plane of the support [m]."""


def plan(
    ctx: Context, panorama: Panorama, background: Background, support: Support, options: OrbitOptions
) -> Collection[Trajectory]:
    """An arc `across` about the vertical and an arc `upwards`, both through the photograph's own camera.

    The camera rotates about its look-at point, so that this point keeps its position in the picture. An arc ends where
    the next camera would be too close to the surface.
    """
    start = support.camera_pose.matrix
    target = start[:3, 3] + _range(background) * start[:3, 2]
    surface = metrics.sample_surface(background.mesh.vertices.astype(np.float64), background.mesh.faces, SAMPLES, 0)
    arcs = {"across": (np.array([0.0, 0.0, 1.0]), options.across_deg), "upwards": (start[:3, 0], options.upwards_deg)}
    found = {}
    for label, (axis, most) in arcs.items():
        angles = np.deg2rad(np.linspace(-most, most, options.cameras | 1))
        turned = np.array([_about(target, axis, angle) @ start for angle in angles])
        kept = _clear_run([_is_clear(place, surface, options.clearance_m) for place in turned[:, :3, 3]])
        if kept.any():
            moved = np.array([poses.from_matrix(pose) for pose in turned[kept]])
            found[label] = Trajectory(
                parent="world", child="camera", stamps=np.arange(len(moved), dtype=np.float64), poses=moved
            )
    return Collection[Trajectory](items=found)


def _range(background: Background) -> float:
    """Depth [m] of the look-at point: the median of the known depths in the middle of the picture, or in all of it."""
    depth = background.depth.depth
    height, width = depth.shape
    middle = depth[height // 3 : height - height // 3, width // 3 : width - width // 3]
    known = middle[middle > 0] if (middle > 0).any() else depth[depth > 0]
    return float(np.median(known)) if known.size else 1.0


def _about(point: np.ndarray, axis: np.ndarray, angle: float) -> np.ndarray:
    """The motion (4, 4) that rotates by `angle` [rad] about an axis through a point."""
    turn = rotation(angle * axis)
    return transforms.rigid(turn, point - turn @ point)


def _is_clear(place: np.ndarray, surface: np.ndarray, clearance: float) -> bool:
    away = float(np.sqrt(((surface - place) ** 2).sum(axis=1).min()))
    return bool(away >= clearance and place[2] >= clearance)


def _clear_run(clear: list[bool]) -> np.ndarray:
    """The cameras (N,) bool that are reached from the middle one without a gap."""
    middle = len(clear) // 2
    kept = np.array(clear)
    kept[middle:] = np.cumprod(kept[middle:]).astype(bool)
    kept[: middle + 1] = np.cumprod(kept[middle::-1])[::-1].astype(bool)
    return kept

"""Cameras on paths, in the order in which they are used."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.spatial.trajectory import Trajectory
from dextera_build.geometry import poses

SAME = 1e-9
"""Poses with smaller differences in every number are one camera."""


def ordered(paths: Collection[Trajectory], place: np.ndarray) -> dict[str, np.ndarray]:
    """Name of the picture -> T_world_camera (4, 4), sorted by distance from `place` (3,) [m], without duplicates."""
    found: dict[str, np.ndarray] = {}
    for label, path in sorted(paths.items.items()):
        for number, pose in enumerate(path.poses):
            matrix = poses.to_matrix(pose)
            if not any(np.abs(matrix - other).max() < SAME for other in found.values()):
                found[f"{label}_{number:03d}.png"] = matrix
    return dict(sorted(found.items(), key=lambda each: float(np.linalg.norm(each[1][:3, 3] - place))))

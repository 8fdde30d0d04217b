"""Inputs and result of backends of align.scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera, Capture
from dextera_build.artifacts.cameras.matches import Matches
from dextera_build.artifacts.scenes.scene_fit import SceneEvidence
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.geometry.scene_pose import ScenePose


@dataclass(frozen=True)
class Given:
    """A photograph and the scene to find in it."""

    capture: Capture  # with depth
    scene: Splats | Mesh
    taken: np.ndarray  # (4, 4) T_G_C of the picture that the scene was made from, in its unit
    ignored: np.ndarray  # (H, W) bool, pixels of the photograph that show no part of the scene
    image: Camera | None = None  # intrinsics of the picture that the scene was made from
    pairs: Matches | None = None  # points of that picture and of the photograph


@dataclass(frozen=True)
class Fitted:
    """Theta with its covariance and evidence."""

    pose: ScenePose
    covariance: np.ndarray  # (7, 7) as in `artifacts.pose.Similarity`
    evidence: SceneEvidence

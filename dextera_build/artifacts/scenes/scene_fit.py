"""Alignment of a generated scene with a photograph of the workspace, with its evidence."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.base import Artifact, Value
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.artifacts.spatial.pose import Similarity
from dextera_build.geometry import transforms


class SceneEvidence(Value):
    """Measures of the quality of an alignment."""

    pairs: int
    """Pairs of matched points of a rendered picture and the photograph."""
    inliers: int
    """Pairs that agree with one pose and one scale."""
    spread: float
    """Fraction of the 12 cells of the photograph with inliers, 0..1."""
    overlap: float
    """Fraction of the measured pixels at which the scene is visible, 0..1."""
    agreement: float
    """Fraction of these with depths that agree within 4 %, 0..1."""
    in_front: float
    """Fraction of these at which the scene is in front of the measurement by more than 6 %, 0..1."""
    correlation: float
    """Correlation of grey values over the used pixels, -1..1."""
    residual_px: float
    """Median reprojection error of inliers [px]."""
    residual_m: float
    """Median difference of their depths [m]."""
    condition: float
    """Condition number of the objective's curvature; shift is in units of the scene's median depth."""


class SceneFit(Artifact):
    """Theta of the paper's Eq. 1, as the similarity from the scene to the camera's frame."""

    motion: Similarity
    """T_camera_scene with its scale: X_camera = matrix @ [scale * X_scene, 1] [m]. In the paper's symbols its scale
    is s_G and the inverse of its matrix is T_G_C, the pose of the camera in the scaled scene."""
    evidence: SceneEvidence
    """Evidence for and against the fit."""
    doubts: tuple[str, ...] = ()
    """Reasons for rejecting it; empty: none."""


class AlignedScene(Artifact):
    """A scene transformed by its alignment: Gaussians and collision mesh, by the same similarity."""

    frame: str
    """Frame of both."""
    splats: Splats | None = None
    """Gaussians: means, scales, orientations and view-dependent colours, transformed."""
    mesh: Mesh | None = None
    """Surface in the same frame [m]."""

    @classmethod
    def of(cls, motion: Similarity, splats: Splats | None, mesh: Mesh | None) -> AlignedScene:
        """Apply scale, then pose, as in X_parent = matrix @ [scale * X_child, 1].

        Args:
            motion: T_parent_scene.
            splats: Gaussians in frame `scene`.
            mesh: Mesh in frame `scene`; meshes have no frame name.

        Raises:
            ArtifactError: The Gaussians are in another frame.
        """
        moved = None
        if mesh is not None:
            places = transforms.apply(motion.matrix, motion.scale * mesh.vertices.astype(np.float64))
            moved = mesh.model_copy(update={"vertices": places.astype(np.float32)})
        return cls(frame=motion.parent, splats=None if splats is None else splats.moved(motion), mesh=moved)

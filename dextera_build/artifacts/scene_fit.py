"""Where a generated scene lies against a photograph of the workspace, and what speaks for it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dextera_build.artifacts.base import Artifact, Value
from dextera_build.artifacts.geometry import Mesh
from dextera_build.artifacts.pose import Similarity
from dextera_build.artifacts.splats import Splats
from dextera_build.geometry import transforms


class SceneEvidence(Value):
    """What was measured of an alignment once it was found."""

    pairs: int
    """Pairs of points that look the same in a rendered picture and in the photograph."""
    inliers: int
    """Those that agree with one pose and one scale."""
    spread: float
    """Part of the 12 cells of the photograph that inliers lie in, 0..1."""
    overlap: float
    """Part of the measured pixels that show a surface of the scene, 0..1."""
    agreement: float
    """Part of these whose depths agree within 4 %, 0..1."""
    in_front: float
    """Part of these where the scene stands before what was measured by more than 6 %, 0..1."""
    correlation: float
    """Of grey values over the pixels that counted, -1..1."""
    residual_px: float
    """Median distance of inliers from where they should be [px]."""
    residual_m: float
    """Median difference of their depths [m]."""
    condition: float
    """Largest over least eigenvalue of the objective's curvature; shift is in units of the scene's median depth."""


class SceneFit(Artifact):
    """Theta of the paper's Eq. 1, as the motion that moves the scene into the camera's frame."""

    motion: Similarity
    """T_camera_scene with its scale: X_camera = matrix @ [scale * X_scene, 1] [m]. In the paper's symbols its scale is
    s_G and the inverse of its matrix is T_G_C, the camera in the scene once that has its scale."""
    evidence: SceneEvidence
    """Evidence for and against the fit."""
    doubts: tuple[str, ...] = ()
    """What speaks against it; empty: nothing."""

    def facts(self) -> Iterator[str]:
        """Scale, standard deviations, evidence, doubts."""
        yield f"scale {self.motion.scale:.4g}"
        if self.motion.covariance is not None:
            spread = np.sqrt(np.diag(self.motion.covariance))
            yield f"{1000 * np.linalg.norm(spread[:3]):.1f} mm, {np.degrees(np.linalg.norm(spread[3:6])):.2f} deg"
        yield f"{self.evidence.inliers} of {self.evidence.pairs} pairs"
        yield from self.doubts


class AlignedScene(Artifact):
    """A scene that a fit has moved: what is seen and what collides, by one motion."""

    frame: str
    """Frame of both."""
    splats: Splats | None = None
    """Gaussians: means, widths, axes and the colours that they show in a direction."""
    mesh: Mesh | None = None
    """Surface in the same frame [m]."""

    @classmethod
    def of(cls, motion: Similarity, splats: Splats | None, mesh: Mesh | None) -> AlignedScene:
        """Apply pose and scale; the scale comes first, as in X_parent = matrix @ [scale * X_child, 1].

        Args:
            motion: T_parent_scene.
            splats: In frame `scene`.
            mesh: In frame `scene`; a mesh does not name its frame.

        Raises:
            ArtifactError: The Gaussians are in another frame.
        """
        moved = None
        if mesh is not None:
            places = transforms.apply(motion.matrix, motion.scale * mesh.vertices.astype(np.float64))
            moved = mesh.model_copy(update={"vertices": places.astype(np.float32)})
        return cls(frame=motion.parent, splats=None if splats is None else splats.moved(motion), mesh=moved)

    def facts(self) -> Iterator[str]:
        """Frame and sizes."""
        yield f"frame {self.frame}"
        if self.splats is not None:
            yield f"{len(self.splats.means):,} Gaussians"
        if self.mesh is not None:
            yield f"{len(self.mesh.faces):,} triangles"

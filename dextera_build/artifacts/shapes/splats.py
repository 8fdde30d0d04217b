"""3D Gaussians for appearance, with the PLY of the authors' code (Kerbl et al. 2023) and USD as file formats."""

from __future__ import annotations

from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from dextera_build.artifacts.base import Array, Artifact
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.spatial.pose import Pose, Similarity, check_frame
from dextera_build.errors import ArtifactError
from dextera_build.gaussians import arrays, splatting
from dextera_build.gaussians.arrays import Gaussians
from dextera_build.gaussians.spherical_harmonics import COUNTS


class Splats(Artifact):
    """3D Gaussians with view-dependent colours."""

    means: Annotated[np.ndarray, Array("N 3", "float32", unit="m", frame="frame")]
    """Centres."""
    rotations: Annotated[np.ndarray, Array("N 4", "float32", frame="frame")]
    """Unit quaternions w, x, y, z: the ellipsoid's axes in the frame."""
    scales: Annotated[np.ndarray, Array("N 3", "float32", unit="m")]
    """Standard deviation along each axis of the ellipsoid, above 0."""
    opacities: Annotated[np.ndarray, Array("N", "float32")]
    """0..1."""
    harmonics: Annotated[np.ndarray, Array("N K 3", "float32", frame="frame")]
    """Coefficients of red, green and blue in the order of `geometry.spherical_harmonics`; K is 1, 4, 9 or 16. 0.5 plus
    their sum in a direction is sRGB 0..1."""
    frame: str = Field("", pattern="^[ -~]*$")
    """Frame of the coordinates; "" if not stated."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        length = np.linalg.norm(self.rotations.astype(np.float64), axis=1)
        faults = {
            "rotations": (np.abs(length - 1) > 1e-3, "are of another length than 1"),
            "scales": ((self.scales <= 0).any(axis=1), "are not above 0"),
            "opacities": ((self.opacities < 0) | (self.opacities > 1), "are outside 0..1"),
        }
        for name, (wrong, what) in faults.items():
            if wrong.any():
                raise ArtifactError(
                    f"Splats.{name}: {int(wrong.sum()):,} of {len(wrong):,} {what}",
                    code="DXB-A405",
                    hint="the fields hold the values themselves, not the logits and logarithms of a PLY file",
                )
        if self.harmonics.shape[1] not in COUNTS:
            raise ArtifactError(
                f"Splats.harmonics: {self.harmonics.shape[1]} coefficients are no degree",
                code="DXB-A406",
                hint="degree 0, 1, 2 or 3 has 1, 4, 9 or 16 coefficients",
            )
        return self

    @property
    def gaussians(self) -> Gaussians:
        """The same in float64."""
        return Gaussians(
            self.means.astype(np.float64),
            self.rotations.astype(np.float64),
            self.scales.astype(np.float64),
            self.opacities.astype(np.float64),
            self.harmonics.astype(np.float64),
        )

    @classmethod
    def of(cls, made: Gaussians, frame: str = "") -> Splats:
        """Gaussians rounded to float32."""
        turns = made.rotations / np.linalg.norm(made.rotations, axis=1, keepdims=True)
        arrays = {"means": made.means, "rotations": turns, "scales": made.scales}
        arrays |= {"opacities": made.opacities, "harmonics": made.harmonics}
        return cls(**{name: array.astype(np.float32) for name, array in arrays.items()}, frame=frame)

    def seen(self, camera: Camera, camera_pose: Pose) -> Image:
        """The rendering by a camera over black; a preview renderer, seconds for 100,000 Gaussians.

        Args:
            camera: Intrinsics.
            camera_pose: T_frame_camera, OpenCV axes.

        Raises:
            ArtifactError: The pose is in another frame.
        """
        check_frame(self.name(), self.frame, camera_pose.inverse())
        size = (camera.height, camera.width)
        light = splatting.render(self.gaussians, camera.matrix(), camera_pose.matrix, size)
        return Image(pixels=np.round(255 * light.clip(0, 1)).astype(np.uint8))

    def moved(self, motion: Pose | Similarity) -> Splats:
        """The same Gaussians in the parent frame of `motion`, with their view-dependent colours rotated.

        Raises:
            ArtifactError: Their frame is not its child.
        """
        check_frame(self.name(), self.frame, motion)
        scale = motion.scale if isinstance(motion, Similarity) else 1.0
        return Splats.of(arrays.moved(self.gaussians, motion.matrix, scale), motion.parent)

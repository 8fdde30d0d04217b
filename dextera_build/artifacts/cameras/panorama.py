"""Panoramas in all directions around one point, as `transforms.json` with a mask."""

from __future__ import annotations

from typing import Annotated, Self

import numpy as np
from pydantic import model_validator

from dextera_build.artifacts.base import Array, Artifact
from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.cameras.lens import Equirectangular
from dextera_build.artifacts.cameras.views import Views, encoded
from dextera_build.artifacts.core.frames import Frames
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import ArtifactError


class Panorama(Artifact):
    """A panorama in all directions around one point."""

    image: Image
    """Equirectangular picture; its centre is straight ahead."""
    pose: Annotated[Pose, Frames(None, "camera")]
    """T_frame_camera: x right, y down, z ahead."""
    seen: Annotated[np.ndarray, Array("H W", "bool")] | None = None
    """Pixels seen by a camera; the others were filled in or generated. None: not stated."""

    @model_validator(mode="after")
    def _check_seen(self) -> Self:
        size = self.image.pixels.shape[:2]
        if self.seen is not None and self.seen.shape != size:
            raise ArtifactError(
                f"Panorama.seen is {self.seen.shape[1]} x {self.seen.shape[0]} px, but the picture is "
                f"{size[1]} x {size[0]} px",
                code="DXB-A203",
            )
        return self

    def lens(self) -> Equirectangular:
        """Its camera."""
        height, width = self.image.pixels.shape[:2]
        return Equirectangular(width=width, height=height)

    def views(self, name: str = "panorama.png") -> Views:
        """The same as views with one picture, without covariance and stamp of the pose, and without `seen`."""
        return Views(
            images={name: encoded(self.image.pixels)},
            names=(name,),
            camera=("1",),
            cameras={"1": self.lens()},
            poses=self.pose.matrix[None].copy(),
            frame=self.pose.parent,
        )

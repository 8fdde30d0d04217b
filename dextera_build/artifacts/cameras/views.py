"""Pictures with their cameras and poses: COLMAP's text model and nerfstudio's `transforms.json`."""

from __future__ import annotations

import io
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from dextera_build.artifacts.base import Array, Artifact, File
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.image import png
from dextera_build.artifacts.cameras.lens import BrownConrady, Equirectangular, KannalaBrandt, Lens
from dextera_build.artifacts.core.file_errors import unreadable
from dextera_build.artifacts.core.labels import check_paths
from dextera_build.artifacts.spatial.point_cloud import PointCloud
from dextera_build.artifacts.spatial.pose import Pose, check_rigid
from dextera_build.errors import ArtifactError, listing

_FORMATS = ("PNG", "JPEG")


class Views(Artifact):
    """Pictures of one scene with known cameras and poses."""

    images: dict[str, File]
    """Path -> PNG or JPEG file; read when it is used."""
    names: tuple[str, ...]
    """Keys of `images`, in the order of the pictures."""
    camera: tuple[str, ...]
    """Per picture: its key in `cameras`."""
    cameras: dict[str, Camera | BrownConrady | KannalaBrandt | Equirectangular]
    """Label -> intrinsics."""
    poses: Annotated[np.ndarray, Array("N 4 4", "float64", unit="m", frame="frame")]
    """T_frame_camera of each picture, OpenCV axes; of a reconstruction without a known scale in its own unit."""
    frame: str = Field("world", pattern=r"^[ -~]+$")
    """Frame of the poses."""
    points: PointCloud | None = None
    """Sparse points of the reconstruction, in `frame`."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        check_paths(self.name(), self.images)
        if sorted(self.names) != sorted(self.images) or not len(self.names) == len(self.camera) == len(self.poses):
            raise ArtifactError(
                "Views: every picture needs one name, one camera and one pose",
                code="DXB-A508",
                facts={
                    "pictures": len(self.images),
                    "names": f"{len(self.names)}, {len(set(self.names))} different",
                    "cameras": len(self.camera),
                    "poses": len(self.poses),
                },
            )
        unknown = sorted(set(self.camera) - set(self.cameras))
        if unknown:
            raise ArtifactError(
                f"Views: there is no camera `{unknown[0]}`", code="DXB-A509", facts={"cameras": listing(self.cameras)}
            )
        for name, pose in zip(self.names, self.poses, strict=True):
            check_rigid(f"the pose of `{name}`", pose)
        return self

    def lens(self, name: str) -> Lens:
        """The camera of a picture."""
        return self.cameras[self.camera[self.names.index(name)]]

    def pose(self, name: str) -> Pose:
        """T_frame_camera of a picture; the child frame is `camera`."""
        return Pose(parent=self.frame, child="camera", matrix=self.poses[self.names.index(name)].copy())

    def pixels(self, name: str) -> np.ndarray:
        """A picture, (H, W, 3) uint8 sRGB.

        Raises:
            ArtifactError: The file is no picture, or differs in size from its camera.
        """
        wanted = self.lens(name)
        pixels = decoded(name, self.images[name])
        if pixels.shape[:2] != (wanted.height, wanted.width):
            raise ArtifactError(
                f"`{name}` does not have the size of its camera",
                code="DXB-A510",
                facts={
                    "picture": f"{pixels.shape[1]} x {pixels.shape[0]} px",
                    "camera": f"{wanted.width} x {wanted.height} px",
                },
                hint="write the intrinsics of this resolution; fx, fy, cx and cy scale with the image",
            )
        return pixels


def encoded(pixels: np.ndarray) -> File:
    """A picture (H, W, 3) uint8 sRGB as a PNG file, for `Views.images`."""
    return File(data=png(pixels))


def decoded(name: str, image: File) -> np.ndarray:
    """A picture, (H, W, 3) uint8 sRGB.

    Raises:
        ArtifactError: The file is neither PNG nor JPEG, or damaged.
    """
    from PIL import Image as Pillow

    try:
        with Pillow.open(io.BytesIO(image.data), formats=_FORMATS) as picture:
            return np.asarray(picture.convert("RGB"))
    except (OSError, ValueError, SyntaxError, Pillow.DecompressionBombError) as error:
        raise unreadable(name, "PNG or JPEG", error) from None

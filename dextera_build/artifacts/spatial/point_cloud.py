"""Point clouds, with PLY as their file format."""

from __future__ import annotations

import re
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from dextera_build.artifacts.base import Array, Artifact
from dextera_build.artifacts.spatial.pose import Pose, Similarity, check_frame
from dextera_build.errors import ArtifactError
from dextera_build.geometry import transforms

XYZ, NORMAL, RGB = ("x", "y", "z"), ("nx", "ny", "nz"), ("red", "green", "blue")
"""PLY properties of the fields; no attribute may have one of these names."""
_TAKEN = {*XYZ, *NORMAL, *RGB}
_WORD = re.compile("[!-~]+")


class PointCloud(Artifact):
    """Points in space, without meaningful order."""

    points: Annotated[np.ndarray, Array("N 3", "float32", unit="m", frame="frame")]
    """Positions."""
    colours: Annotated[np.ndarray, Array("N 3", "uint8")] | None = None
    """Red, green, blue in sRGB, 0..255."""
    normals: Annotated[np.ndarray, Array("N 3", "float32", frame="frame")] | None = None
    """Unit directions out of the surface; (0, 0, 0) where unknown."""
    attributes: dict[str, Annotated[np.ndarray, Array("N", "float32")]] = Field(default_factory=dict)
    """Name -> further numbers of every point: `confidence`, `intensity`."""
    frame: str = Field("", pattern="^[ -~]*$")
    """Frame of the coordinates; "" if not stated."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.normals is not None:
            length = np.linalg.norm(self.normals.astype(np.float64), axis=1)
            wrong = int(((np.abs(length - 1) > 1e-3) & (length > 0)).sum())
            if wrong:
                raise ArtifactError(
                    f"PointCloud.normals: {wrong:,} of {len(length):,} are of another length than 1",
                    code="DXB-A403",
                    hint="divide each by its length, or write (0, 0, 0) where the normal is unknown",
                )
        for name in self.attributes:
            if name in _TAKEN or not _WORD.fullmatch(name):
                raise ArtifactError(
                    f"PointCloud.attributes: {name!r} is no free name of a PLY property",
                    code="DXB-A404",
                    hint="a name is printable ASCII without spaces, and not that of a coordinate, normal or colour",
                )
        return self

    def moved(self, motion: Pose | Similarity) -> PointCloud:
        """The same points in the parent frame of `motion`.

        Raises:
            ArtifactError: The cloud's frame is not its child.
        """
        check_frame(self.name(), self.frame, motion)
        scale = motion.scale if isinstance(motion, Similarity) else 1.0
        fields = {name: getattr(self, name) for name in type(self).model_fields}
        fields["points"] = transforms.apply(motion.matrix, scale * self.points.astype(np.float64)).astype(np.float32)
        if self.normals is not None:
            fields["normals"] = (self.normals @ motion.matrix[:3, :3].T).astype(np.float32)
        return PointCloud(**fields | {"frame": motion.parent})

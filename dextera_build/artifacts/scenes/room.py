"""The static scene around the objects as 3D Gaussians."""

from __future__ import annotations

from typing import Self

from pydantic import Field, model_validator

from dextera_build.artifacts.base import Artifact
from dextera_build.artifacts.cameras.image import DepthImage
from dextera_build.artifacts.objects.object import AssetSource
from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.artifacts.spatial.point_cloud import PointCloud
from dextera_build.errors import ArtifactError


class Room(Artifact):
    """The static scene, composed from many views, for rendering; collision geometry is in `Background.boxes`."""

    splats: Splats
    """Gaussians of all views together."""
    points: PointCloud
    """Points of the same surfaces, in the same frame."""
    depth: dict[str, DepthImage] = Field(default_factory=dict)
    """Name of a view -> its depth, of the size of its picture, for views with estimated depth."""
    asset_source: AssetSource = "rgb"
    """Source of the geometry: that of the background, `rgb` if only views were given."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.points.frame != self.splats.frame:
            raise ArtifactError(
                f"Room: the points are in frame `{self.points.frame}`, the Gaussians in `{self.splats.frame}`",
                code="DXB-A208",
                hint="move one of them: `points.moved(pose)`",
            )
        return self

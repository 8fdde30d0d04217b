"""Poses of an object over time, with CSV as file format."""

from __future__ import annotations

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from dextera_build.artifacts.base import Array, Artifact
from dextera_build.artifacts.spatial import stamped
from dextera_build.errors import ArtifactError

Status = Literal["tracked", "predicted", "lost"]


class Track(Artifact):
    """Poses of an object in a frame, one per picture or measurement, including those at which it is lost."""

    parent: str = Field(pattern=r"^\S+$")
    """Frame that the poses are in."""
    child: str = Field(pattern=r"^\S+$")
    """The object."""
    stamps: Annotated[np.ndarray, Array("N", "float64", unit="s")]
    """Times, increasing."""
    poses: Annotated[np.ndarray, Array("N 7", "float64", unit="m", frame="parent", finite=False)]
    """T_parent_child: position, and unit quaternion w x y z; NaN where it is lost."""
    status: tuple[Status, ...]
    """Per stamp: `tracked`, measured; `predicted`, extrapolated without a measurement; `lost`, no pose."""
    covariances: Annotated[np.ndarray, Array("N 6 6", "float64", frame="parent")] | None = None
    """Covariance of translation [m] and rotation vector [rad], see `geometry.uncertainty`; zeros where it is lost."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        known = np.array([status != "lost" for status in self.status], bool)
        if len(known) != len(self.stamps) or not len(known):
            raise ArtifactError(
                f"Track: {len(known)} statuses for {len(self.stamps)} stamps; both need as many, and at least one",
                code="DXB-A505",
            )
        there = np.isfinite(self.poses).all(axis=1)
        if (there != known).any() or not np.isnan(self.poses[~known]).all():
            wrong = int(np.flatnonzero((there != known) | (~known & ~np.isnan(self.poses).all(axis=1)))[0])
            raise ArtifactError(
                f"Track: the pose at {self.stamps[wrong]} s does not fit its status `{self.status[wrong]}`",
                code="DXB-A506",
                hint="a lost pose is NaN throughout, and any other one is finite",
            )
        stamped.check(self.name(), self.stamps, self.poses, self.covariances)
        return self

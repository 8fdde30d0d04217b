"""The trajectory of a frame in another one, with the text format of the TUM RGB-D benchmark."""

from __future__ import annotations

from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from dextera_build.artifacts.base import Array, Artifact
from dextera_build.artifacts.spatial import stamped
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import ArtifactError
from dextera_build.geometry import poses


class Trajectory(Artifact):
    """Poses of one frame in another at increasing times."""

    parent: str = Field(pattern=r"^\S+$")
    """Frame that the poses are in."""
    child: str = Field(pattern=r"^\S+$")
    """Moving frame."""
    stamps: Annotated[np.ndarray, Array("N", "float64", unit="s")]
    """Times, increasing."""
    poses: Annotated[np.ndarray, Array("N 7", "float64", unit="m", frame="parent")]
    """T_parent_child: position, and unit quaternion w x y z."""
    covariances: Annotated[np.ndarray, Array("N 6 6", "float64", frame="parent")] | None = None
    """Covariance of translation [m] and rotation vector [rad], see `geometry.uncertainty`; None: exact, or not
    stated."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not len(self.stamps):
            raise ArtifactError("a Trajectory needs a pose", code="DXB-A503")
        stamped.check(self.name(), self.stamps, self.poses, self.covariances)
        return self

    def at(self, stamp: float) -> Pose:
        """The pose at a time [s]: linear in position, slerp in rotation, linear in covariance.

        Raises:
            ArtifactError: The time is outside the trajectory.
        """
        first, last = float(self.stamps[0]), float(self.stamps[-1])
        if not first <= stamp <= last:
            raise ArtifactError(
                f"the trajectory of `{self.child}` does not cover {stamp} s",
                code="DXB-A504",
                facts={"from": f"{first} s", "to": f"{last} s"},
                hint="ask for a time within it; both clocks must be the same",
            )
        after = min(int(np.searchsorted(self.stamps, stamp)), len(self.stamps) - 1)
        before = max(after - 1, 0)
        gap = float(self.stamps[after] - self.stamps[before])
        share = (stamp - float(self.stamps[before])) / gap if gap else 1.0
        pose = stamped.between(self.poses[before], self.poses[after], share)
        spread = self.covariances
        covariance = None if spread is None else (1 - share) * spread[before] + share * spread[after]
        return Pose(
            parent=self.parent, child=self.child, matrix=poses.to_matrix(pose), covariance=covariance, stamp=stamp
        )

    def length_m(self) -> float:
        """Length of the path [m]."""
        return float(np.linalg.norm(np.diff(self.poses[:, :3], axis=0), axis=1).sum())

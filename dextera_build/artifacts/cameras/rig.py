"""Rigs of rigidly mounted cameras, with Kalibr's `camchain.yaml` as file format."""

from __future__ import annotations

from typing import Self

from pydantic import model_validator

from dextera_build.artifacts.base import Artifact
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.lens import BrownConrady, Equirectangular, KannalaBrandt
from dextera_build.artifacts.core.labels import check_labels
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import ArtifactError


class Rig(Artifact):
    """Cameras on one body."""

    cameras: dict[str, Camera | BrownConrady | KannalaBrandt | Equirectangular]
    """Label -> intrinsics."""
    poses: dict[str, Pose]
    """Label -> T_rig_camera, with a covariance if known; the child frame is the label."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        check_labels(self.name(), self.cameras)
        frames = {(pose.parent, pose.child) for pose in self.poses.values()}
        if self.cameras.keys() != self.poses.keys() or frames != {("rig", label) for label in self.cameras}:
            raise ArtifactError(
                "Rig: every camera needs one pose T_rig_LABEL",
                code="DXB-A513",
                facts={
                    "cameras": " ".join(sorted(self.cameras)),
                    "poses": " ".join(
                        sorted(f"{label}: T_{pose.parent}_{pose.child}" for label, pose in self.poses.items())
                    ),
                },
            )
        return self

    def between(self, first: str, second: str) -> Pose:
        """T_first_second of two cameras; their covariances are assumed to be independent."""
        return self.poses[first].inverse() @ self.poses[second]

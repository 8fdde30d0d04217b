"""Rigs of rigidly mounted cameras, with Kalibr's `camchain.yaml` as file format."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar, Self

import numpy as np
from pydantic import model_validator

from dextera_build.artifacts import camchain, lens
from dextera_build.artifacts.base import Artifact
from dextera_build.artifacts.camera import Camera
from dextera_build.artifacts.formats import suffix_among, unreadable, unwritable
from dextera_build.artifacts.image import png
from dextera_build.artifacts.labels import check_labels
from dextera_build.artifacts.lens import BrownConrady, Equirectangular, KannalaBrandt
from dextera_build.artifacts.pose import Pose
from dextera_build.errors import ArtifactError
from dextera_build.geometry.plot import COLOURS, Line, plot


class Rig(Artifact):
    """Cameras on one body."""

    saves: ClassVar[tuple[str, ...]] = (".yaml",)

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

    def facts(self) -> Iterator[str]:
        """Number of cameras, and the longest distance between two."""
        yield f"{len(self.cameras)} cameras ({', '.join(sorted(self.cameras))})"
        places = np.array([pose.matrix[:3, 3] for pose in self.poses.values()]).reshape(-1, 3)
        if len(places) > 1:
            far = np.linalg.norm(places[:, None] - places[None], axis=-1).max()
            yield f"at most {1000 * far:.0f} mm apart"

    def picture(self) -> bytes:
        """The cameras in the plane of x and z of the rig, each with its viewing direction."""
        matrices = [self.poses[label].matrix for label in sorted(self.poses)]
        places = np.array([matrix[[0, 2], 3] for matrix in matrices]).reshape(-1, 2)
        reach = 0.4 * float(np.ptp(places, axis=0).max(initial=0)) or 0.1
        ways = [matrix[[0, 2], 2] for matrix in matrices]
        rays = [Line(np.stack([place, place + reach * way])) for place, way in zip(places, ways, strict=True)]
        return png(plot([*rays, Line(places, COLOURS[1], dots=True)], "x [m]", "z [m]", equal=True))

    def _write(self, path: Path) -> list[Path]:
        rows = [
            camchain.Mounted(label, self.cameras[label].intrinsics(), pose.matrix, pose.covariance)
            for label, pose in sorted(self.poses.items())
        ]
        try:
            path.write_text(camchain.written(rows))
        except ValueError as error:
            raise unwritable(self.name(), "a Kalibr camchain", error) from None
        return [path]

    @classmethod
    def load(cls, path: str | Path) -> Rig:
        """Read a Kalibr `camchain.yaml`; the rig's frame is that of the IMU, or of the first camera without one.

        Raises:
            ArtifactError: It is no such file, or its numbers are no valid cameras.
        """
        suffix_among(cls.name(), Path(path), (".yaml", ".yml"))
        return cls.parse(Path(path).read_bytes(), path)

    @classmethod
    def parse(cls, data: bytes, path: str | Path) -> Rig:
        """The rig in the content of a camchain that is named `path`."""
        try:
            found = camchain.read(data.decode())
        except ValueError as error:
            raise unreadable(path, "a Kalibr camchain", error) from None
        return cls(
            cameras={each.label: lens.of(each.lens) for each in found},
            poses={
                each.label: Pose(parent="rig", child=each.label, matrix=each.pose, covariance=each.covariance)
                for each in found
            },
        )

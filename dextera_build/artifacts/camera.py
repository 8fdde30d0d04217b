"""Cameras and captures."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Self

import numpy as np
from pydantic import model_validator

from dextera_build.artifacts.base import Artifact
from dextera_build.artifacts.image import DepthImage, Image
from dextera_build.errors import ArtifactError


class Camera(Artifact):
    """A pinhole camera: OpenCV convention, integer pixel centres, x right, y down, z forward."""

    width: int
    """Image width [px]."""
    height: int
    """Image height [px]."""
    fx: float
    """Focal length along x [px]."""
    fy: float
    """Focal length along y [px]."""
    cx: float
    """Principal point, x [px]."""
    cy: float
    """Principal point, y [px]."""

    def matrix(self) -> np.ndarray:
        """K, (3, 3) float64 [px]."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]], dtype=np.float64)

    def crop(self, left: int, top: int, width: int, height: int) -> Camera:
        """The camera of the sub-image whose upper left pixel is (`left`, `top`)."""
        return Camera(width=width, height=height, fx=self.fx, fy=self.fy, cx=self.cx - left, cy=self.cy - top)


class Capture(Artifact):
    """One RGB-D picture of a workspace."""

    rgb: Image
    """The photograph."""
    depth: DepthImage
    """Depth registered to the photograph, same size."""
    camera: Camera
    """Intrinsics of both."""

    def export(self, folder: str | Path, stem: str) -> list[Path]:
        """Write the files that `capture.folder` reads: `rgb.png`, `depth.png` in millimetres, `capture.json`."""
        folder = Path(folder)
        facts = self.camera.model_dump() | {"depth_scale_m": 0.001}
        written = [*self.rgb.export(folder, "rgb"), *self.depth.export(folder, "depth"), folder / "capture.json"]
        written[-1].write_text(json.dumps(facts, indent=1) + "\n")
        return written

    @model_validator(mode="after")
    def _check_sizes(self) -> Self:
        size = (self.camera.height, self.camera.width)
        for name, shape in (("rgb", self.rgb.pixels.shape[:2]), ("depth", self.depth.depth.shape)):
            if shape != size:
                raise ArtifactError(
                    f"Capture.{name} is {shape[1]} x {shape[0]} px, but the intrinsics say {size[1]} x {size[0]} px",
                    code="DXB-A203",
                )
        return self

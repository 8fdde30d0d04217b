"""Cameras, photographs, and depth measured together with them."""

from __future__ import annotations

from typing import Self

import numpy as np
from pydantic import model_validator

from dextera_build.artifacts.base import Artifact
from dextera_build.artifacts.cameras.image import DepthImage, Image
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

    def turned(self, count: int) -> Camera:
        """The camera of the picture turned counter-clockwise by `count` quarter turns, see `geometry.upright`."""
        found = self
        for _ in range(count % 4):
            found = Camera(
                width=found.height,
                height=found.width,
                fx=found.fy,
                fy=found.fx,
                cx=found.cy,
                cy=found.width - 1 - found.cx,
            )
        return found

    def scaled(self, factor: float) -> Camera:
        """The camera of the whole image at `factor` times its size, rounded to pixels.

        The borders of the image scale; integer pixel centres are half a pixel inside.
        """
        width, height = (max(1, round(side * factor)) for side in (self.width, self.height))
        across, down = width / self.width, height / self.height
        return Camera(
            width=width,
            height=height,
            fx=self.fx * across,
            fy=self.fy * down,
            cx=(self.cx + 0.5) * across - 0.5,
            cy=(self.cy + 0.5) * down - 0.5,
        )

    def project(self, points: np.ndarray) -> np.ndarray:
        """Pixels (N, 2) of points (N, 3) in the camera frame; NaN behind the camera."""
        ahead = np.where(points[:, 2:] > 0, points[:, 2:], np.nan)
        return np.asarray(points[:, :2] / ahead * [self.fx, self.fy] + [self.cx, self.cy])

    def unproject(self, pixels: np.ndarray) -> np.ndarray:
        """Unit directions (N, 3) in the camera frame of pixels (N, 2)."""
        plane = (pixels - [self.cx, self.cy]) / [self.fx, self.fy]
        rays = np.column_stack([plane, np.ones(len(plane))])
        return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))


class Photograph(Artifact):
    """One RGB picture and its camera; the only input from which assets are made."""

    rgb: Image
    """The picture."""
    camera: Camera
    """Intrinsics."""
    gravity: tuple[float, float, float] | None = None
    """Direction in which things fall in the camera frame, a unit vector, from an inertial sensor; None if unknown."""

    @model_validator(mode="after")
    def _check_sizes(self) -> Self:
        _check_size("Photograph.rgb", self.rgb.pixels.shape[:2], self.camera)
        return self


class Measured(Artifact):
    """Measurements of a depth camera at the photograph's pose; for alignment, and for backends that declare it."""

    depth: DepthImage
    """Depth registered to the photograph, same size and intrinsics."""


class Capture(Artifact):
    """A photograph of a workspace, with simultaneous measurements."""

    photograph: Photograph
    """The picture with its camera."""
    measured: Measured | None = None
    """Depth; None if there is only the photograph."""

    @model_validator(mode="after")
    def _check_sizes(self) -> Self:
        if self.measured is not None:
            _check_size("Capture.measured.depth", self.measured.depth.depth.shape, self.photograph.camera)
        return self


def _check_size(name: str, shape: tuple[int, ...], camera: Camera) -> None:
    if shape != (camera.height, camera.width):
        raise ArtifactError(
            f"{name} is {shape[1]} x {shape[0]} px, but the intrinsics are for {camera.width} x {camera.height} px",
            code="DXB-A203",
        )

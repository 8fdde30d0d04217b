"""Lenses other than the pinhole, and the noise of a depth camera."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field, PositiveFloat, PositiveInt

from dextera_build.artifacts.base import Artifact
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.geometry import lenses

Number = Annotated[float, Field(allow_inf_nan=False)]
Focal = Annotated[PositiveFloat, Field(allow_inf_nan=False)]
Chance = Annotated[float, Field(ge=0, le=1)]


class BrownConrady(Artifact):
    """A lens with radial and tangential distortion: OpenCV's and ROS's `plumb_bob` or `rational_polynomial` model.

    OpenCV axes and integer pixel centres, as `Camera`; without distortion it is that camera.
    """

    width: PositiveInt
    """Image width [px]."""
    height: PositiveInt
    """Image height [px]."""
    fx: Focal
    """Focal length along x [px]."""
    fy: Focal
    """Focal length along y [px]."""
    cx: Number
    """Principal point, x [px]."""
    cy: Number
    """Principal point, y [px]."""
    k1: Number = 0.0
    """Radial, r^2."""
    k2: Number = 0.0
    """Radial, r^4."""
    p1: Number = 0.0
    """Tangential, along y."""
    p2: Number = 0.0
    """Tangential, along x."""
    k3: Number = 0.0
    """Radial, r^6."""
    k4: Number = 0.0
    """Radial, r^2 of the denominator; not 0 in the rational model only."""
    k5: Number = 0.0
    """Radial, r^4 of the denominator."""
    k6: Number = 0.0
    """Radial, r^6 of the denominator."""

    def coefficients(self) -> np.ndarray:
        """(8,) float64 in OpenCV's order: k1 k2 p1 p2 k3 k4 k5 k6."""
        return np.array([self.k1, self.k2, self.p1, self.p2, self.k3, self.k4, self.k5, self.k6])

    def project(self, points: np.ndarray) -> np.ndarray:
        """Pixels (N, 2) of points (N, 3) in the camera frame; NaN behind it and where the model is not invertible."""
        k = self.coefficients()
        ahead = points[:, 2:] > 0
        plane = points[:, :2] / np.where(ahead, points[:, 2:], np.nan)
        inside = np.hypot(*plane.T)[:, None] <= lenses.brown_conrady_limit(k)
        return _pixels(self, lenses.brown_conrady(np.where(inside, plane, np.nan), k))

    def unproject(self, pixels: np.ndarray) -> np.ndarray:
        """Unit directions (N, 3) in the camera frame of pixels (N, 2); NaN outside the image of the lens."""
        plane = lenses.brown_conrady_inverse(_plane(self, pixels), self.coefficients())
        return lenses.directions(plane, np.arctan(np.hypot(*plane.T)))


class KannalaBrandt(Artifact):
    """A fisheye lens: OpenCV's fisheye model, `equidistant` in ROS; its field of view may exceed 180 degrees."""

    width: PositiveInt
    """Image width [px]."""
    height: PositiveInt
    """Image height [px]."""
    fx: Focal
    """Focal length along x [px]."""
    fy: Focal
    """Focal length along y [px]."""
    cx: Number
    """Principal point, x [px]."""
    cy: Number
    """Principal point, y [px]."""
    k1: Number = 0.0
    """Third power of the angle off the axis."""
    k2: Number = 0.0
    """Fifth power."""
    k3: Number = 0.0
    """Seventh power."""
    k4: Number = 0.0
    """Ninth power."""

    def coefficients(self) -> np.ndarray:
        """(4,) float64: k1 to k4."""
        return np.array([self.k1, self.k2, self.k3, self.k4])

    def project(self, points: np.ndarray) -> np.ndarray:
        """Pixels (N, 2) of points (N, 3) in the camera frame; NaN at angles where the model is not invertible."""
        k, across = self.coefficients(), points[:, :2]
        off = np.hypot(*across.T)
        theta = np.arctan2(off, points[:, 2])
        theta = np.where(theta <= lenses.kannala_brandt_limit(k), theta, np.nan)
        scale = lenses.kannala_brandt(theta, k) / np.where(off > 0, off, 1.0)
        return _pixels(self, across * scale[:, None])

    def unproject(self, pixels: np.ndarray) -> np.ndarray:
        """Unit directions (N, 3) in the camera frame of pixels (N, 2); NaN outside the image of the lens."""
        plane = _plane(self, pixels)
        return lenses.directions(plane, lenses.kannala_brandt_inverse(np.hypot(*plane.T), self.coefficients()))


class Equirectangular(Artifact):
    """The whole sphere: columns are azimuth, rows are elevation, and the middle of the image is straight ahead."""

    width: PositiveInt
    """Image width [px], 360 degrees."""
    height: PositiveInt
    """Image height [px], 180 degrees."""

    def project(self, points: np.ndarray) -> np.ndarray:
        """Pixels (N, 2) of points (N, 3) in the camera frame; -0.5 <= u < width - 0.5."""
        x, y, z = points.T
        u = np.arctan2(x, z) / (2 * np.pi) * self.width + (self.width - 1) / 2
        v = np.arctan2(y, np.hypot(x, z)) / np.pi * self.height + (self.height - 1) / 2
        return np.stack([np.where(u >= self.width - 0.5, u - self.width, u), v], axis=1)

    def unproject(self, pixels: np.ndarray) -> np.ndarray:
        """Unit directions (N, 3) in the camera frame of pixels (N, 2); NaN above and below the image."""
        azimuth = (pixels[:, 0] - (self.width - 1) / 2) / self.width * 2 * np.pi
        elevation = (pixels[:, 1] - (self.height - 1) / 2) / self.height * np.pi
        elevation = np.where(np.abs(elevation) <= np.pi / 2, elevation, np.nan)
        level = np.cos(elevation)
        return np.column_stack([level * np.sin(azimuth), np.sin(elevation), level * np.cos(azimuth)])


Lens = Camera | BrownConrady | KannalaBrandt | Equirectangular
"""Every camera has `width`, `height`, `project`, `unproject` and `intrinsics`."""


def _pixels(lens: BrownConrady | KannalaBrandt, plane: np.ndarray) -> np.ndarray:
    """Pixels (N, 2) of positions (N, 2) in focal lengths from the principal point."""
    return np.asarray(plane * [lens.fx, lens.fy] + [lens.cx, lens.cy])


def _plane(lens: BrownConrady | KannalaBrandt, pixels: np.ndarray) -> np.ndarray:
    return np.asarray((pixels - [lens.cx, lens.cy]) / [lens.fx, lens.fy])

"""EXIF data of a photograph: its orientation and the focal length of the lens."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.rule import Context

from .pictures import opened

_ORIENTATION, _PHOTO = 0x0112, 0x8769
_FOCAL, _FOCAL_35MM, _PLANE_X, _PLANE_UNIT, _WIDTH, _HEIGHT = 0x920A, 0xA405, 0xA20E, 0xA210, 0xA002, 0xA003
_UNIT_MM = {2: 25.4, 3: 10.0, 4: 1.0}
"""Length of the unit of `FocalPlaneResolutionUnit` [mm]."""
_FILM_MM = math.hypot(36.0, 24.0)
"""Diagonal of 35 mm film; equivalent focal lengths have the same diagonal angle of view (CIPA DCG-001)."""
SENSORS = (1.0, 4 / 3, 3 / 2, 16 / 9)
"""Longer over shorter side of pictures as cameras take them."""
_SAME = 0.02
"""Relative difference of two aspect ratios that counts as none."""


class Exif(NamedTuple):
    """Size and EXIF tags of an image file."""

    size: tuple[int, int]
    """Width and height as stored [px]."""
    orientation: int
    """1 to 8; 1 is upright."""
    focal_35mm: float | None = None
    """Focal length of the lens that gives this angle of view on 35 mm film [mm]."""
    focal_px: float | None = None
    """Focal length times the resolution of the sensor, in pixels of the picture as it was taken [px]."""
    taken: tuple[int, int] | None = None
    """Width and height of the picture as it was taken [px]."""

    @property
    def upright_size(self) -> tuple[int, int]:
        """Width and height as shown [px]."""
        return self.size[::-1] if self.orientation >= 5 else self.size

    @property
    def cropped(self) -> str:
        """Why the picture seems to be cropped; empty if it does not."""
        if self.taken is not None and not _alike(_aspect(self.taken), _aspect(self.size)):
            return f"{self.taken[0]} x {self.taken[1]} px were taken and {self.size[0]} x {self.size[1]} px are here"
        if not any(_alike(_aspect(self.size), aspect) for aspect in SENSORS):
            return f"its sides are {_aspect(self.size):.2f} to 1, unlike those of any camera"
        return ""

    @property
    def source(self) -> str:
        """The tags that give the focal length; empty without any."""
        if self.focal_35mm is not None:
            return f"a focal length of {self.focal_35mm:g} mm on 35 mm film"
        return "" if self.focal_px is None else "a focal length and the resolution of the sensor"

    def camera(self) -> Camera | None:
        """A pinhole camera with square pixels and the image centre as principal point, or None.

        A picture that was resized has its focal length resized; one that was cropped is taken to have its pixels as
        they were.
        """
        taken = self.size if self.taken is None else self.taken
        focal = self.focal_px
        if self.focal_35mm is not None:  # stated by phones, whose resolution of the sensor is often that of a preview
            focal = self.focal_35mm / _FILM_MM * math.hypot(*taken)
        if focal is None:
            return None
        if _alike(_aspect(taken), _aspect(self.size)):
            focal *= max(self.size) / max(taken)
        width, height = self.upright_size
        return Camera(width=width, height=height, fx=focal, fy=focal, cx=(width - 1) / 2, cy=(height - 1) / 2)


def read(ctx: Context, data: bytes, name: str) -> Exif:
    """Size and tags from the header of an image file; invalid tags are ignored."""
    orientation: Any = 1
    photo: Mapping[int, Any] = {}
    with opened(ctx, data, name) as picture:
        size = picture.size
        if "exif" in picture.info:  # without it, Pillow decodes a PNG to look for the tags after the pixels
            with suppress(Exception):  # a damaged tag raises any exception of its parser
                tags = picture.getexif()
                orientation, photo = tags.get(_ORIENTATION, 1), tags.get_ifd(_PHOTO)
    density = _number(photo, _PLANE_X, 1e6) or 0.0
    unit = photo.get(_PLANE_UNIT, 2)
    focal_px = (_number(photo, _FOCAL, 1000.0) or 0.0) * density / _UNIT_MM.get(unit, math.inf)
    taken = tuple(int(_number(photo, tag, 1e5) or 0) for tag in (_WIDTH, _HEIGHT))
    return Exif(
        size,
        orientation if orientation in range(2, 9) else 1,
        _number(photo, _FOCAL_35MM, 500.0, least=5.0),
        focal_px if 0.3 < focal_px / max(size) < 30.0 else None,
        (taken[0], taken[1]) if min(taken) >= max(8, min(size) // 2) else None,
    )


def _number(tags: Mapping[int, Any], tag: int, most: float, least: float = 0.0) -> float | None:
    """A tag's number if it is within bounds."""
    try:
        value = float(tags[tag])
    except (KeyError, TypeError, ValueError, ZeroDivisionError):
        return None
    return value if least < value <= most or value == least > 0 else None


def _aspect(size: tuple[int, int]) -> float:
    return max(size) / min(size)


def _alike(first: float, second: float) -> bool:
    return abs(first / second - 1.0) < _SAME


def upright(pixels: np.ndarray, orientation: int) -> np.ndarray:
    """The picture (H, W, C) in its display orientation."""
    if orientation in (2, 4, 5, 7):
        pixels = pixels[:, ::-1]
    turns = {3: 2, 4: 2, 5: 1, 6: -1, 7: -1, 8: 1}.get(orientation, 0)
    return np.ascontiguousarray(np.rot90(pixels, turns))

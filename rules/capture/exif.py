"""EXIF data of a photograph: its orientation and the focal length of the lens."""

from __future__ import annotations

import math
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.rule import Context

from .pictures import opened

_ORIENTATION, _PHOTO, _FOCAL_35MM = 0x0112, 0x8769, 0xA405
_FILM_MM = math.hypot(36.0, 24.0)
"""Diagonal of 35 mm film; equivalent focal lengths have the same diagonal angle of view (CIPA DCG-001)."""


class Exif(NamedTuple):
    """Size and EXIF tags of an image file."""

    size: tuple[int, int]
    """Width and height as stored [px]."""
    orientation: int
    """1 to 8; 1 is upright."""
    focal_35mm: float | None
    """Focal length of the lens that gives this angle of view on 35 mm film [mm]."""

    @property
    def upright_size(self) -> tuple[int, int]:
        """Width and height as shown [px]."""
        return self.size[::-1] if self.orientation >= 5 else self.size

    def camera(self) -> Camera | None:
        """A pinhole camera with square pixels and the image centre as principal point, or None."""
        if self.focal_35mm is None:
            return None
        width, height = self.upright_size
        focal = self.focal_35mm / _FILM_MM * math.hypot(width, height)
        return Camera(width=width, height=height, fx=focal, fy=focal, cx=(width - 1) / 2, cy=(height - 1) / 2)


def read(ctx: Context, data: bytes, name: str) -> Exif:
    """Size and tags from the header of an image file; invalid tags are ignored."""
    orientation: Any = 1
    focal: Any = None
    with opened(ctx, data, name) as picture:
        size = picture.size
        if "exif" in picture.info:  # without it, Pillow decodes a PNG to look for the tags after the pixels
            with suppress(Exception):  # a damaged tag raises any exception of its parser
                tags = picture.getexif()
                orientation, focal = tags.get(_ORIENTATION, 1), tags.get_ifd(_PHOTO).get(_FOCAL_35MM)
    sound = isinstance(focal, int | float) and 5.0 <= focal <= 500.0
    return Exif(size, orientation if orientation in range(2, 9) else 1, float(focal) if sound else None)


def upright(pixels: np.ndarray, orientation: int) -> np.ndarray:
    """The picture (H, W, C) in its display orientation."""
    if orientation in (2, 4, 5, 7):
        pixels = pixels[:, ::-1]
    turns = {3: 2, 4: 2, 5: 1, 6: -1, 7: -1, 8: 1}.get(orientation, 0)
    return np.ascontiguousarray(np.rot90(pixels, turns))

"""Pictures: colour, depth, masks, label maps."""

from __future__ import annotations

import io
from typing import Annotated, Any

import numpy as np

from dextera_build import digest
from dextera_build.artifacts.base import Array, Artifact

TEXTURES = ("PNG", "JPEG", "WEBP", "BMP", "TGA", "TIFF", "GIF")
"""Supported formats of textures; Pillow has others, some of which run programs."""
MOST_ENCODED = 24
"""Number of pictures whose PNG is remembered, the latest."""
_ENCODED: dict[str, bytes] = {}


class Image(Artifact):
    """A colour picture in sRGB."""

    pixels: Annotated[np.ndarray, Array("H W 3", "uint8")]
    """Red, green, blue (never BGR), 0..255."""


class DepthImage(Artifact):
    """Distance along the optical axis (image-plane z, not along the ray)."""

    depth: Annotated[np.ndarray, Array("H W", "float32", unit="m", frame="camera")]
    """Depth z; 0 where nothing was measured."""


class LabelImage(Artifact):
    """One instance label per pixel."""

    labels: Annotated[np.ndarray, Array("H W", "int32")]
    """0 is background; 1.. are instances."""


def faded(pixels: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """A copy of (H, W, 3) uint8 that is pale outside a mask (H, W) bool."""
    pale = (pixels.astype(np.uint16) + 3 * 255) // 4
    return np.where(mask[..., None], pixels, pale).astype(np.uint8)


def smaller(pixels: np.ndarray, longest: int = 640) -> np.ndarray:
    """Every n-th pixel, with n chosen to make no side longer than `longest`."""
    step = -(-max(pixels.shape[:2]) // longest) or 1
    return pixels[::step, ::step]


def png(pixels: np.ndarray, level: int = 2) -> bytes:
    """PNG bytes of (H, W, 3) uint8, (H, W) uint8, (H, W) bool or (H, W) uint16.

    Level 2 of zlib takes a quarter of the time of its default 6, for bytes of photographs and renders that are a tenth
    larger.
    """
    if pixels.dtype == np.bool_:
        pixels = pixels.astype(np.uint8) * 255
    pixels = np.ascontiguousarray(pixels)
    # A scene is written several times with the same textures, as MJCF, URDF and USD.
    name = f"{digest.of_bytes(pixels.tobytes())} {pixels.shape} {pixels.dtype} {level}"
    if name not in _ENCODED:
        if len(_ENCODED) == MOST_ENCODED:
            _ENCODED.pop(next(iter(_ENCODED)))
        _ENCODED[name] = _encoded(pixels, level)
    return _ENCODED[name]


def _encoded(pixels: np.ndarray, level: int) -> bytes:
    from PIL import Image as Pillow

    buffer = io.BytesIO()
    Pillow.fromarray(pixels).save(buffer, format="PNG", compress_level=level)
    return buffer.getvalue()


def opened(data: bytes, name: str) -> Any:
    """The `PIL.Image` in the bytes of a texture called `name`; `rgb` decodes it.

    Raises:
        ValueError: It is in none of the formats of `TEXTURES`, or too large.
    """
    from PIL import Image as Pillow

    try:
        return Pillow.open(io.BytesIO(data), formats=TEXTURES)
    except Pillow.DecompressionBombError as error:
        raise ValueError(f"the picture `{name}` is too large: {error}") from None
    except (OSError, SyntaxError, ValueError):
        raise ValueError(f"the picture `{name}` is none of {', '.join(TEXTURES)}, or damaged") from None


def rgb(picture: Any) -> np.ndarray:
    """Pixels (H, W, 3) uint8 of a `PIL.Image`.

    Raises:
        ValueError: It is damaged, or in none of the formats of `TEXTURES`.
    """
    if picture.format not in (None, *TEXTURES):  # None once it was converted
        raise ValueError(f"a picture is in the format {picture.format}; {', '.join(TEXTURES)} are read")
    try:
        return np.asarray(picture.convert("RGB"))
    except (OSError, SyntaxError, ValueError) as error:
        raise ValueError(f"a picture cannot be read: {error}") from None

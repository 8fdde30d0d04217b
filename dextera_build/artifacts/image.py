"""Pictures: colour, depth, masks, label maps."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Annotated

import numpy as np

from dextera_build.artifacts.base import Array, Artifact


class Image(Artifact):
    """A colour picture in sRGB."""

    pixels: Annotated[np.ndarray, Array("H W 3", "uint8")]
    """Red, green, blue (never BGR), 0..255."""

    def export(self, folder: Path, stem: str) -> list[Path]:
        """Write `stem.png`."""
        return _write(folder / f"{stem}.png", png(self.pixels))


class DepthImage(Artifact):
    """Distance along the optical axis (image-plane z, not along the ray)."""

    depth: Annotated[np.ndarray, Array("H W", "float32", unit="m", frame="camera")]
    """Depth z; 0 where nothing was measured."""

    def export(self, folder: Path, stem: str) -> list[Path]:
        """Write `stem.png`: 16 bit, one count is a millimetre, 0 is invalid."""
        counts = np.clip(np.round(self.depth * 1000.0), 0, 65535).astype(np.uint16)
        return _write(folder / f"{stem}.png", png(counts))


class LabelImage(Artifact):
    """One instance label per pixel."""

    labels: Annotated[np.ndarray, Array("H W", "int32")]
    """0 is background; 1.. are instances."""


def png(pixels: np.ndarray) -> bytes:
    """PNG bytes of (H, W, 3) uint8, (H, W) uint8, (H, W) bool or (H, W) uint16."""
    from PIL import Image as Pillow

    if pixels.dtype == np.bool_:
        pixels = pixels.astype(np.uint8) * 255
    buffer = io.BytesIO()
    Pillow.fromarray(np.ascontiguousarray(pixels)).save(buffer, format="PNG")
    return buffer.getvalue()


def _write(path: Path, data: bytes) -> list[Path]:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return [path]

"""`Image` and `DepthImage` as PNG."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dextera_build.artifacts.cameras.image import DepthImage, Image, png


def save(picture: Image | DepthImage, path: Path) -> list[Path]:
    """Write sRGB, or depth in 16 bit: one count is a millimetre, 0 is invalid."""
    if isinstance(picture, Image):
        path.write_bytes(png(picture.pixels))
    else:
        path.write_bytes(png(np.clip(np.round(picture.depth * 1000.0), 0, 65535).astype(np.uint16)))
    return [path]

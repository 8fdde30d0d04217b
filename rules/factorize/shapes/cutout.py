"""The program's side of generators that take a picture with transparent surroundings; needs NumPy and Pillow."""

from __future__ import annotations

from typing import Any


def rgba(request: Any) -> Any:
    """The crop of the photograph as a Pillow image, opaque inside the mask."""
    import numpy as np
    from PIL import Image

    with Image.open(request.inputs["image"].path, formats=("PNG",)) as opened:
        pixels = np.asarray(opened.convert("RGB"))
    mask = np.load(request.inputs["mask"].path, allow_pickle=False)
    return Image.fromarray(np.dstack([pixels, mask.astype(np.uint8) * 255]), "RGBA")

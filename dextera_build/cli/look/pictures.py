"""Pictures of the difference between two pictures: the old one, the new one, and how far they are apart."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

    from dextera_build.artifacts.difference import Difference

_SMALLEST = 8
"""Pixels along an edge below which two axes are no picture."""


def draw(found: Difference, get: Callable[[str], bytes], folder: Path) -> Path | None:
    """Write old, new and difference side by side; None where the field is no picture, or its form changed."""
    if found.blobs is None or found.form is None or not _is_picture(*found.form):
        return None
    import numpy as np

    from dextera_build.artifacts.difference import distance
    from dextera_build.artifacts.image import png

    dtype, shape = found.form
    old, new = (np.frombuffer(get(blob), dtype=np.dtype(dtype)).reshape(shape) for blob in found.blobs)
    apart = distance(old, new)
    if apart.ndim == 3:
        apart = apart.max(axis=2)
    known = np.concatenate([side[np.isfinite(side)].astype(np.float64) for side in (old, new)])
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    reach = float(apart[np.isfinite(apart)].max(initial=0.0))
    panels = [_shades(old, low, high), _shades(new, low, high), _shades(apart, 0.0, reach)]
    path = folder / f"{re.sub(r'[^A-Za-z0-9_.-]+', '_', found.path)}.png"
    folder.mkdir(parents=True, exist_ok=True)
    path.write_bytes(png(np.concatenate(panels, axis=1)))
    return path


def _is_picture(dtype: str, shape: tuple[int, ...]) -> bool:
    if len(shape) == 3:
        return dtype == "uint8" and shape[2] == 3 and min(shape[:2]) >= _SMALLEST
    return len(shape) == 2 and min(shape) >= _SMALLEST


def _shades(values: np.ndarray, low: float, high: float) -> np.ndarray:
    """(H, W, 3) uint8: colours as they are, numbers from black at `low` to white at `high`."""
    import numpy as np

    if values.ndim == 3:
        return values
    with np.errstate(invalid="ignore"):
        share = (values.astype(np.float64) - low) / ((high - low) or 1.0)
    grey = np.clip(np.nan_to_num(share, nan=1.0), 0.0, 1.0)
    return np.repeat((grey * 255.0).round().astype(np.uint8)[..., None], 3, axis=2)

"""Lenses as fields of view and squares of ten degrees."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from dextera_build.artifacts.base import Artifact
from dextera_build.artifacts.cameras.image import png, smaller
from dextera_build.artifacts.cameras.lens import BrownConrady, Equirectangular, KannalaBrandt
from dextera_build.geometry import lenses


def _facts(lens: BrownConrady | KannalaBrandt) -> Iterator[str]:
    """Size and fields of view."""
    yield f"{lens.width} x {lens.height} px"
    x, y = (lens.width - 1) / 2, (lens.height - 1) / 2
    ends = np.array([[0, y], [lens.width - 1, y], [x, 0], [x, lens.height - 1]])
    off = np.arctan2(np.hypot(*lens.unproject(ends)[:, :2].T), lens.unproject(ends)[:, 2])
    if np.isfinite(off).all():
        across, down = np.degrees([off[0] + off[1], off[2] + off[3]])
        yield f"field of view {across:.0f} x {down:.0f} deg"
    yield f"focal length {lens.fx:.4g}, {lens.fy:.4g} px"


def _checker(lens: BrownConrady | KannalaBrandt | Equirectangular) -> bytes:
    """Squares of ten degrees through the lens."""
    rows, columns = np.indices((lens.height, lens.width), dtype=np.float64)
    chosen = smaller(np.stack([columns, rows], axis=-1))
    rays = lens.unproject(chosen.reshape(-1, 2)).reshape(*chosen.shape[:2], 3)
    return png(lenses.angle_checker(rays))


FACTS: Mapping[type[Artifact], Callable[[Any], Iterator[str]]] = {
    BrownConrady: _facts,
    KannalaBrandt: _facts,
}
PICTURES: Mapping[type[Artifact], Callable[[Any], bytes]] = {
    BrownConrady: _checker,
    Equirectangular: _checker,
    KannalaBrandt: _checker,
}

"""Volume difference between a solid and the convex pieces that approximate it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.shapes.mesh import Hull

if TYPE_CHECKING:
    from manifold3d import Manifold


def errors(solid: Manifold, hulls: Sequence[Hull]) -> tuple[float, float]:
    """Volume of the pieces outside the solid, and of the solid outside the pieces, over the volume of the solid.

    Pieces overlap, so their union is measured; a sum of their volumes would count overlaps as errors.
    """
    import manifold3d

    parts = [manifold3d.Manifold.hull_points(hull.vertices.astype(np.float64)) for hull in hulls]
    covered = manifold3d.Manifold.batch_boolean(parts, manifold3d.OpType.Add)
    whole = max(float(solid.volume()), 1e-12)
    return max(float((covered - solid).volume()), 0.0) / whole, max(float((solid - covered).volume()), 0.0) / whole

"""Gaussians as Warp arrays, for pictures without gradients and without PyTorch."""

from __future__ import annotations

import numpy as np
import warp as wp

from dextera_build.gaussians.arrays import Gaussians
from dextera_build.gaussians.rasteriser.raster import Parameters

LEAST = 1e-4
"""Minimum distance of opacities from 0 and 1, where their logit is infinite."""


def placed(given: Gaussians, device: str) -> Parameters:
    """Gaussians as float32 arrays on a device, `cpu` or `cuda`."""
    opacities = given.opacities.clip(LEAST, 1 - LEAST)
    logits = np.log(opacities) - np.log1p(-opacities)
    arrays = (given.means, given.rotations, np.log(given.scales), logits, given.harmonics)
    kinds = (wp.vec3, wp.vec4, wp.vec3, wp.float32, wp.vec3)
    return Parameters(
        *(
            wp.array(np.ascontiguousarray(each, np.float32), dtype=kind, device=device)
            for each, kind in zip(arrays, kinds, strict=True)
        )
    )

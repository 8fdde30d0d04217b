"""Kernels that project Gaussians to the picture, and their gradients.

A projected Gaussian has eight numbers: column and row of its centre [px]; xx, xy, yy of the inverse covariance
[1/px^2]; the largest exponent at which it is visible; its opacity; its depth [m].
"""

# No `from __future__ import annotations`: Warp reads the annotations of kernels, which are types of this call.
from functools import cache
from typing import Any

import warp as wp

from dextera_build.gaussians.rasteriser.harmonics import harmonic
from dextera_build.gaussians.rasteriser.shapes import flattening, scaled, turned

TILE_PX = 16
"""Side of a tile [px]."""
LOW_PASS_PX2 = 0.3
"""Variance that is added along both axes of the picture."""
LEAST, MOST = 1 / 255, 0.99
"""Opacities in one pixel: lower ones are skipped, higher ones are clipped."""


@wp.func
def boxed(left: Any, top: Any, right: Any, bottom: Any, size: wp.vec2i) -> wp.vec4i:
    """First and last tile column and row that a box of pixels touches; an empty box if none."""
    none = left - left
    last_column = type(left)(size[0] - 1)
    last_row = type(left)(size[1] - 1)
    if right < none or bottom < none or left > last_column or top > last_row:
        return wp.vec4i(0, 0, -1, -1)
    return wp.vec4i(
        int(wp.max(left, none)) / TILE_PX,
        int(wp.max(top, none)) / TILE_PX,
        int(wp.min(right, last_column)) / TILE_PX,
        int(wp.min(bottom, last_row)) / TILE_PX,
    )


@cache
def projecting(real: Any) -> Any:
    """The kernel from parameters to projected Gaussians: `flat`, `colours`, their tiles and the number of them."""
    three, four, eight = (wp.types.vector(length, real) for length in (3, 4, 8))
    seven, grid = wp.types.vector(7, real), wp.types.matrix((3, 3), real)

    @wp.kernel(module="unique", enable_backward=False)
    def project(
        means: wp.array[three],
        quaternions: wp.array[four],
        log_scales: wp.array[three],
        logits: wp.array[real],
        harmonics: wp.array2d[three],
        turn: grid,
        eye: three,
        lens: seven,
        size: wp.vec2i,
        faded: int,
        flat: wp.array[eight],
        colours: wp.array[three],
        boxes: wp.array[wp.vec4i],
        counts: wp.array[wp.int32],
    ) -> None:
        i = wp.tid()
        counts[i] = 0
        p = turn * (means[i] - eye)
        opacity = real(1.0) / (real(1.0) + wp.exp(-logits[i]))
        if p[2] <= lens[6] or opacity < real(LEAST):
            return
        half = scaled(
            turned(wp.normalize(four(quaternions[i]))),
            three(wp.exp(log_scales[i][0]), wp.exp(log_scales[i][1]), wp.exp(log_scales[i][2])),
        )
        across = flattening(lens, p) * turn * half
        spread = across * wp.transpose(across)
        xx = spread[0, 0] + real(LOW_PASS_PX2)
        xy = spread[0, 1]
        yy = spread[1, 1] + real(LOW_PASS_PX2)
        determinant = xx * yy - xy * xy
        if faded == 1:
            opacity *= wp.sqrt(wp.max(spread[0, 0] * spread[1, 1] - xy * xy, real(0.0)) / determinant)
        if not determinant > real(0.0) or opacity < real(LEAST):
            return
        cut = wp.log(opacity / real(LEAST))
        column = lens[0] * p[0] / p[2] + lens[2]
        row = lens[1] * p[1] / p[2] + lens[3]
        flat[i] = eight(column, row, yy / determinant, -xy / determinant, xx / determinant, cut, opacity, p[2])
        wide = wp.sqrt(real(2.0) * cut * xx)
        high = wp.sqrt(real(2.0) * cut * yy)
        box = boxed(column - wide, row - high, column + wide, row + high, size)
        boxes[i] = box
        counts[i] = (box[2] - box[0] + 1) * (box[3] - box[1] + 1)
        way = wp.normalize(means[i] - eye)
        colour = three(real(0.5), real(0.5), real(0.5))
        for k in range(harmonics.shape[1]):
            colour += harmonic(k, way) * harmonics[i, k]
        colours[i] = three(wp.max(colour[0], real(0.0)), wp.max(colour[1], real(0.0)), wp.max(colour[2], real(0.0)))

    return project

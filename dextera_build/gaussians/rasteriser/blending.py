"""Kernels for alpha blending of the Gaussians of a tile, one thread per pixel, and for its gradients."""

# No `from __future__ import annotations`: Warp reads the annotations of kernels, which are types of this call.
from functools import cache
from typing import Any

import warp as wp

from dextera_build.gaussians.rasteriser.projection import MOST, TILE_PX

LEAST_LIGHT = 1e-4
"""A Gaussian that would reduce the transmittance below this is skipped, with all behind it."""


@wp.func
def spotted(first: int, number: int, size: wp.vec2i) -> wp.vec3i:
    """Tile, column and row of a pixel, counted tile by tile from tile `first`."""
    tile = first + number / (TILE_PX * TILE_PX)
    within = number % (TILE_PX * TILE_PX)
    wide = (size[0] + TILE_PX - 1) / TILE_PX
    column = (tile % wide) * TILE_PX + within % TILE_PX
    return wp.vec3i(tile, column, (tile / wide) * TILE_PX + within / TILE_PX)


@wp.func
def exponent(g: Any, dx: Any, dy: Any) -> Any:
    """Minus the logarithm of a Gaussian `g`, see `projection`, `dx` and `dy` [px] from its centre, over its peak."""
    return type(dx)(0.5) * (g[2] * dx * dx + g[4] * dy * dy) + g[3] * dx * dy


@cache
def blending(real: Any) -> Any:
    """The kernel from sorted Gaussians to pixels: colour, depth, and transmittance within the pixel's depth limit."""
    three, eight = (wp.types.vector(length, real) for length in (3, 8))

    @wp.kernel(module="unique", enable_backward=False)
    def blend(
        first: int,
        size: wp.vec2i,
        starts: wp.array[wp.int32],
        flat: wp.array[eight],
        colours: wp.array[three],
        limits: wp.array[real],
        picture: wp.array[three],
        depth: wp.array[real],
        light: wp.array[real],
        lasts: wp.array[wp.int32],
    ) -> None:
        spot = spotted(first, wp.tid(), size)
        tile = spot[0]
        column = spot[1]
        row = spot[2]
        if column >= size[0] or row >= size[1]:
            return
        passing = real(1.0)
        colour = three()
        far = real(0.0)
        last = starts[tile]
        limit = limits[row * size[0] + column]
        for k in range(starts[tile], starts[tile + 1]):
            g = flat[k]
            if g[7] > limit:
                break
            dx = real(column) - g[0]
            dy = real(row) - g[1]
            e = exponent(g, dx, dy)
            if e > g[5] or e < real(0.0):
                continue
            alpha = wp.min(g[6] * wp.exp(-e), real(MOST))
            left = passing * (real(1.0) - alpha)
            if left <= real(LEAST_LIGHT):
                break
            weight = passing * alpha
            colour += weight * colours[k]
            far += weight * g[7]
            passing = left
            last = k + 1
        pixel = row * size[0] + column
        picture[pixel] = colour
        depth[pixel] = far
        light[pixel] = passing
        lasts[pixel] = last

    return blend


@cache
def unblending(real: Any) -> Any:
    """The kernel from gradients of pixels to those of each Gaussian in each tile, from far to near."""
    three, eight = (wp.types.vector(length, real) for length in (3, 8))

    @wp.kernel(module="unique", enable_backward=False)
    def unblend(
        first: int,
        size: wp.vec2i,
        starts: wp.array[wp.int32],
        flat: wp.array[eight],
        colours: wp.array[three],
        light: wp.array[real],
        lasts: wp.array[wp.int32],
        to_picture: wp.array[three],
        to_depth: wp.array[real],
        to_light: wp.array[real],
        to_flat: wp.array[eight],
        to_colours: wp.array[three],
    ) -> None:
        spot = spotted(first, wp.tid(), size)
        tile = spot[0]
        column = spot[1]
        row = spot[2]
        if column >= size[0] or row >= size[1]:
            return
        pixel = row * size[0] + column
        toned = to_picture[pixel]
        far = to_depth[pixel]
        passing = light[pixel]
        # Weight of the light behind the current Gaussian.
        behind = passing * to_light[pixel]
        for step in range(lasts[pixel] - starts[tile]):
            k = lasts[pixel] - 1 - step
            g = flat[k]
            dx = real(column) - g[0]
            dy = real(row) - g[1]
            e = exponent(g, dx, dy)
            if e > g[5] or e < real(0.0):
                continue
            soft = wp.exp(-e)
            alpha = wp.min(g[6] * soft, real(MOST))
            passing = passing / (real(1.0) - alpha)
            weight = passing * alpha
            worth = wp.dot(colours[k], toned) + g[7] * far
            to_alpha = passing * worth - behind / (real(1.0) - alpha)
            behind += weight * worth
            shape = eight()
            shape[7] = weight * far
            if g[6] * soft <= real(MOST):
                slope = -alpha * to_alpha
                shape[0] = -slope * (g[2] * dx + g[3] * dy)
                shape[1] = -slope * (g[4] * dy + g[3] * dx)
                shape[2] = real(0.5) * slope * dx * dx
                shape[3] = slope * dx * dy
                shape[4] = real(0.5) * slope * dy * dy
                shape[6] = soft * to_alpha
            wp.atomic_add(to_flat, k, shape)
            wp.atomic_add(to_colours, k, weight * toned)

    return unblend

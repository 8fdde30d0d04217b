"""Kernels for gradients of projected Gaussians with respect to their parameters."""

# No `from __future__ import annotations`: Warp reads the annotations of kernels, which are types of this call.
from functools import cache
from typing import Any

import warp as wp

from dextera_build.gaussians.rasteriser.harmonics import harmonic, harmonic_slope
from dextera_build.gaussians.rasteriser.shapes import (
    flattening,
    flattening_gradient,
    normalised_gradient,
    scaled,
    turned,
    turned_gradient,
)


@cache
def adding(real: Any) -> Any:
    """The kernel that sums the gradients of each Gaussian over its pairs with tiles.

    The order of summation is fixed, so that sums are deterministic.
    """
    three, eight = (wp.types.vector(length, real) for length in (3, 8))

    @wp.kernel(module="unique", enable_backward=False)
    def add(
        counts: wp.array[wp.int32],
        ends: wp.array[wp.int32],
        places: wp.array[wp.int32],
        of_pairs: wp.array[eight],
        colours_of_pairs: wp.array[three],
        to_flat: wp.array[eight],
        to_colours: wp.array[three],
    ) -> None:
        i = wp.tid()
        shape = eight()
        colour = three()
        for k in range(ends[i] - counts[i], ends[i]):
            shape += of_pairs[places[k]]
            colour += colours_of_pairs[places[k]]
        to_flat[i] = shape
        to_colours[i] = colour

    return add


@cache
def recolouring(real: Any) -> Any:
    """The kernel from gradients of colours to those of coefficients, and of means through the viewing direction."""
    three = wp.types.vector(3, real)

    @wp.kernel(module="unique", enable_backward=False)
    def recolour(
        means: wp.array[three],
        harmonics: wp.array2d[three],
        eye: three,
        colours: wp.array[three],
        counts: wp.array[wp.int32],
        to_colours: wp.array[three],
        to_means: wp.array[three],
        to_harmonics: wp.array2d[three],
    ) -> None:
        i = wp.tid()
        if counts[i] == 0:
            return
        ray = means[i] - eye
        way = wp.normalize(ray)
        shown = to_colours[i]
        for c in range(3):
            # Colours clamped to 0 have no gradient.
            if not colours[i][c] > real(0.0):
                shown[c] = real(0.0)
        to_way = three()
        for k in range(harmonics.shape[1]):
            to_harmonics[i, k] = harmonic(k, way) * shown
            to_way += harmonic_slope(k, way) * wp.dot(harmonics[i, k], shown)
        to_means[i] = normalised_gradient(way, wp.length(ray), to_way)

    return recolour


@cache
def reshaping(real: Any) -> Any:
    """The kernel from gradients of `flat` to those of quaternions, scales and opacities; it adds those of means."""
    three, four, eight = (wp.types.vector(length, real) for length in (3, 4, 8))
    seven, grid, pair = wp.types.vector(7, real), wp.types.matrix((3, 3), real), wp.types.matrix((2, 2), real)

    @wp.kernel(module="unique", enable_backward=False)
    def reshape(
        means: wp.array[three],
        quaternions: wp.array[four],
        log_scales: wp.array[three],
        turn: grid,
        eye: three,
        lens: seven,
        flat: wp.array[eight],
        counts: wp.array[wp.int32],
        to_flat: wp.array[eight],
        to_means: wp.array[three],
        to_quaternions: wp.array[four],
        to_log_scales: wp.array[three],
        to_logits: wp.array[real],
    ) -> None:
        i = wp.tid()
        if counts[i] == 0:
            return
        g = to_flat[i]
        to_logits[i] = g[6] * flat[i][6] * (real(1.0) - flat[i][6])
        # Covariance in the picture, from its inverse.
        conic = pair(flat[i][2], flat[i][3], flat[i][3], flat[i][4])
        to_spread = -conic * pair(g[2], real(0.5) * g[3], real(0.5) * g[3], g[4]) * conic
        length = wp.length(quaternions[i])
        unit = quaternions[i] / length
        scales = three(wp.exp(log_scales[i][0]), wp.exp(log_scales[i][1]), wp.exp(log_scales[i][2]))
        half = scaled(turned(unit), scales)
        p = turn * (means[i] - eye)
        across = flattening(lens, p) * turn
        to_across = real(2.0) * to_spread * across * half * wp.transpose(half)
        to_half = real(2.0) * wp.transpose(across) * to_spread * across * half
        to_quaternions[i] = normalised_gradient(unit, length, turned_gradient(unit, scaled(to_half, scales)))
        for c in range(3):
            to_log_scales[i][c] = to_half[0, c] * half[0, c] + to_half[1, c] * half[1, c] + to_half[2, c] * half[2, c]
        # Position in the camera: the Jacobian of the shape, the centre, the depth.
        to_p = flattening_gradient(lens, p, to_across * wp.transpose(turn))
        across_u = lens[0] / p[2] * g[0]
        across_v = lens[1] / p[2] * g[1]
        to_p += three(across_u, across_v, g[7] - (across_u * p[0] + across_v * p[1]) / p[2])
        to_means[i] = to_means[i] + wp.transpose(turn) * to_p

    return reshape

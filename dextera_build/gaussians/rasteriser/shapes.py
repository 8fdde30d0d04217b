"""Rotations of quaternions and covariances in Warp, and their gradients; generic in the floating-point type."""

from __future__ import annotations

from typing import Any

import warp as wp


@wp.func
def turned(q: Any) -> Any:
    """Rotation (3, 3) of the unit quaternion w, x, y, z."""
    w = q[0]
    x = q[1]
    y = q[2]
    z = q[3]
    one = type(w)(1.0)
    two = type(w)(2.0)
    return wp.matrix_from_rows(
        wp.vector(one - two * (y * y + z * z), two * (x * y - w * z), two * (x * z + w * y)),
        wp.vector(two * (x * y + w * z), one - two * (x * x + z * z), two * (y * z - w * x)),
        wp.vector(two * (x * z - w * y), two * (y * z + w * x), one - two * (x * x + y * y)),
    )


@wp.func
def turned_gradient(q: Any, g: Any) -> Any:
    """Gradient of the unit quaternion from that of its rotation, `g` (3, 3)."""
    w = q[0]
    x = q[1]
    y = q[2]
    z = q[3]
    two = type(w)(2.0)
    return two * wp.vector(
        x * (g[2, 1] - g[1, 2]) + y * (g[0, 2] - g[2, 0]) + z * (g[1, 0] - g[0, 1]),
        y * (g[0, 1] + g[1, 0]) + z * (g[0, 2] + g[2, 0]) + w * (g[2, 1] - g[1, 2]) - two * x * (g[1, 1] + g[2, 2]),
        x * (g[0, 1] + g[1, 0]) + z * (g[1, 2] + g[2, 1]) + w * (g[0, 2] - g[2, 0]) - two * y * (g[0, 0] + g[2, 2]),
        x * (g[0, 2] + g[2, 0]) + y * (g[1, 2] + g[2, 1]) + w * (g[1, 0] - g[0, 1]) - two * z * (g[0, 0] + g[1, 1]),
    )


@wp.func
def normalised_gradient(unit: Any, length: Any, g: Any) -> Any:
    """Gradient of a vector from that of its direction `unit`, `g`."""
    return (g - unit * wp.dot(unit, g)) / length


@wp.func
def scaled(turn: Any, s: Any) -> Any:
    """R diag(s), (3, 3), the factor of the covariance R S S R^T."""
    return wp.matrix_from_cols(
        wp.vector(turn[0, 0] * s[0], turn[1, 0] * s[0], turn[2, 0] * s[0]),
        wp.vector(turn[0, 1] * s[1], turn[1, 1] * s[1], turn[2, 1] * s[1]),
        wp.vector(turn[0, 2] * s[2], turn[1, 2] * s[2], turn[2, 2] * s[2]),
    )


@wp.func
def clamped(value: Any, limit: Any) -> Any:
    """The value within -limit..limit."""
    return wp.min(wp.max(value, -limit), limit)


@wp.func
def flattening(lens: Any, p: Any) -> Any:
    """Derivative (2, 3) of pixels with respect to the position `p` in the camera, at a direction within the limits.

    `lens` is fx, fy, cx, cy [px], the largest |x / z| and |y / z|, and the least depth [m].
    """
    none = p[0] - p[0]
    z = p[2]
    tx = clamped(p[0] / z, lens[4])
    ty = clamped(p[1] / z, lens[5])
    return wp.matrix_from_rows(
        wp.vector(lens[0] / z, none, -lens[0] * tx / z),
        wp.vector(none, lens[1] / z, -lens[1] * ty / z),
    )


@wp.func
def flattening_gradient(lens: Any, p: Any, g: Any) -> Any:
    """Gradient of the position `p` from that of `flattening`, `g` (2, 3); clamped directions have none."""
    none = p[0] - p[0]
    z = p[2]
    zz = z * z
    x = p[0] / z
    y = p[1] / z
    tx = clamped(x, lens[4])
    ty = clamped(y, lens[5])
    vz = -lens[0] / zz * g[0, 0] - lens[1] / zz * g[1, 1] + lens[0] * tx / zz * g[0, 2] + lens[1] * ty / zz * g[1, 2]
    vx = none
    vy = none
    if tx == x:
        vx = -lens[0] / zz * g[0, 2]
        vz = vz - x * vx
    if ty == y:
        vy = -lens[1] / zz * g[1, 2]
        vz = vz - y * vy
    return wp.vector(vx, vy, vz)

"""Spherical harmonics in Warp, in the order and with the signs of `geometry.spherical_harmonics`, and their gradients.

Functions are generic: they compute in the type of their argument.
"""

from __future__ import annotations

from typing import Any

import warp as wp


@wp.func
def harmonic(k: int, d: Any) -> Any:
    """Value of function `k` in the unit direction `d`."""
    x = d[0]
    y = d[1]
    z = d[2]
    value = type(x)(0.28209479177387814)
    if k > 8:
        value = _third(k, x, y, z)
    elif k > 3:
        value = _second(k, x, y, z)
    elif k == 1:
        value = type(x)(-0.4886025119029199) * y
    elif k == 2:
        value = type(x)(0.4886025119029199) * z
    elif k == 3:
        value = type(x)(-0.4886025119029199) * x
    return value


@wp.func
def _second(k: int, x: Any, y: Any, z: Any) -> Any:
    value = type(x)(1.0925484305920792) * x * y
    if k == 5:
        value = type(x)(-1.0925484305920792) * y * z
    elif k == 6:
        value = type(x)(0.31539156525252005) * (type(x)(2.0) * z * z - x * x - y * y)
    elif k == 7:
        value = type(x)(-1.0925484305920792) * x * z
    elif k == 8:
        value = type(x)(0.5462742152960396) * (x * x - y * y)
    return value


@wp.func
def _third(k: int, x: Any, y: Any, z: Any) -> Any:
    xx = x * x
    yy = y * y
    zz = z * z
    value = type(x)(-0.5900435899266435) * y * (type(x)(3.0) * xx - yy)
    if k == 10:
        value = type(x)(2.890611442640554) * x * y * z
    elif k == 11:
        value = type(x)(-0.4570457994644658) * y * (type(x)(4.0) * zz - xx - yy)
    elif k == 12:
        value = type(x)(0.3731763325901154) * z * (type(x)(2.0) * zz - type(x)(3.0) * (xx + yy))
    elif k == 13:
        value = type(x)(-0.4570457994644658) * x * (type(x)(4.0) * zz - xx - yy)
    elif k == 14:
        value = type(x)(1.445305721320277) * z * (xx - yy)
    elif k == 15:
        value = type(x)(-0.5900435899266435) * x * (xx - type(x)(3.0) * yy)
    return value


@wp.func
def harmonic_slope(k: int, d: Any) -> Any:
    """Gradient of function `k` with respect to x, y, z of the direction."""
    x = d[0]
    y = d[1]
    z = d[2]
    none = x - x
    slope = wp.vector(none, none, none)
    if k > 8:
        slope = _third_slope(k, x, y, z)
    elif k > 3:
        slope = _second_slope(k, x, y, z)
    elif k == 1:
        slope = wp.vector(none, type(x)(-0.4886025119029199), none)
    elif k == 2:
        slope = wp.vector(none, none, type(x)(0.4886025119029199))
    elif k == 3:
        slope = wp.vector(type(x)(-0.4886025119029199), none, none)
    return slope


@wp.func
def _second_slope(k: int, x: Any, y: Any, z: Any) -> Any:
    none = x - x
    a = type(x)(1.0925484305920792)
    slope = wp.vector(a * y, a * x, none)
    if k == 5:
        slope = wp.vector(none, -a * z, -a * y)
    elif k == 6:
        b = type(x)(0.6307831305050401)
        slope = wp.vector(-b * x, -b * y, type(x)(2.0) * b * z)
    elif k == 7:
        slope = wp.vector(-a * z, none, -a * x)
    elif k == 8:
        slope = wp.vector(a * x, -a * y, none)
    return slope


@wp.func
def _third_slope(k: int, x: Any, y: Any, z: Any) -> Any:
    xx = x * x
    yy = y * y
    zz = z * z
    two = type(x)(2.0)
    a = type(x)(1.7701307697799304)
    c = type(x)(0.4570457994644658)
    slope = wp.vector(-two * a * x * y, -a * (xx - yy), x - x)
    if k == 10:
        b = type(x)(2.890611442640554)
        slope = b * wp.vector(y * z, x * z, x * y)
    elif k == 11:
        slope = c * wp.vector(two * x * y, xx + type(x)(3.0) * yy - type(x)(4.0) * zz, -type(x)(8.0) * y * z)
    elif k == 12:
        e = type(x)(1.1195289977703462)
        slope = e * wp.vector(-two * x * z, -two * y * z, two * zz - xx - yy)
    elif k == 13:
        slope = c * wp.vector(type(x)(3.0) * xx + yy - type(x)(4.0) * zz, two * x * y, -type(x)(8.0) * x * z)
    elif k == 14:
        b = type(x)(1.445305721320277)
        slope = b * wp.vector(two * x * z, -two * y * z, xx - yy)
    elif k == 15:
        slope = wp.vector(-a * (xx - yy), two * a * x * y, x - x)
    return slope

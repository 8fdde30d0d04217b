"""Local planes of an organised depth image.

The inverse depth of a plane is linear over the image: w = 1/z = a u + b v + c, and the noise of a triangulating camera
is uniform in w. Local planes are therefore fitted to w, which is exact for planes at any slant.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class LocalPlanes:
    """One plane per pixel: w(u + du, v + dv) ~ c + a du + b dv around pixel (u, v)."""

    a: np.ndarray  # (H, W) slope along columns [1/(m px)]
    b: np.ndarray  # (H, W) slope along rows [1/(m px)]
    c: np.ndarray  # (H, W) inverse depth at the pixel [1/m]
    residual: np.ndarray  # (H, W) root mean square of w about the plane [1/m]
    count: np.ndarray  # (H, W) pixels used

    def at(self, rows: np.ndarray, columns: np.ndarray, down: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Inverse depth that the plane of pixel (row, column) predicts `down` rows and `right` columns away."""
        return np.asarray(
            self.c[rows, columns] + self.a[rows, columns] * right + self.b[rows, columns] * down, dtype=np.float64
        )

    def normals(self, k: np.ndarray) -> np.ndarray:
        """Unit normals (H, W, 3) towards the camera, camera frame; 0 without a plane.

        Args:
            k: (3, 3) intrinsics of this (sub-)image [px].
        """
        height, width = self.c.shape
        rows, columns = np.mgrid[0:height, 0:width]
        base = self.c - self.a * (columns - k[0, 2]) - self.b * (rows - k[1, 2])
        normal = np.stack([self.a * k[0, 0], self.b * k[1, 1], base], axis=-1)
        length = np.linalg.norm(normal, axis=-1, keepdims=True)
        # n . ray = w / |n| > 0, so the direction that faces the camera is the negative one.
        return np.where(length > 0, -normal / np.maximum(length, 1e-12), 0.0)


def fit(inverse: np.ndarray, tolerance: np.ndarray, radius: int = 4) -> LocalPlanes:
    """Fit a plane to the window around each pixel, twice: to all near pixels, then to those on that plane.

    Args:
        inverse: (H, W) inverse depth [1/m]; 0 where nothing was measured.
        tolerance: (H, W) standard deviation of `inverse` [1/m].
        radius: Half window [px].
    """
    step = 0.02 * inverse + 2.0 * tolerance
    zero = np.zeros_like(inverse)
    first = _solve(inverse, zero, zero, inverse, step, radius)
    return _solve(inverse, first.a, first.b, first.c, 3.0 * tolerance, radius)


def sharpen(planes: LocalPlanes, inverse: np.ndarray, tolerance: np.ndarray, reach: int = 4) -> LocalPlanes:
    """Near creases, use the plane of a neighbour whose window does not cross the crease.

    A pixel keeps its own plane if that explains its window within the noise, so curved surfaces stay smooth.
    """
    best = {name: getattr(planes, name).copy() for name in ("a", "b", "c", "residual", "count")}
    cost = np.where(planes.count >= 6, planes.residual - 0.5 * tolerance, np.inf)
    for down in (-reach, 0, reach):
        for right in (-reach, 0, reach):
            moved = {name: _shift(getattr(planes, name), down, right) for name in best}
            predicted = moved["c"] - moved["a"] * right - moved["b"] * down
            fits = (moved["count"] >= 6) & (np.abs(predicted - inverse) < 2.0 * tolerance) & (inverse > 0)
            better = fits & (moved["residual"] < cost)
            cost[better] = moved["residual"][better]
            moved["c"] = predicted
            for name in best:
                best[name][better] = moved[name][better]
    return LocalPlanes(**best)


def _shift(values: np.ndarray, down: int, right: int) -> np.ndarray:
    """out[v, u] = values[v + down, u + right], 0 outside."""
    height, width = values.shape
    out = np.zeros_like(values)
    rows = slice(max(0, -down), min(height, height - down))
    columns = slice(max(0, -right), min(width, width - right))
    from_rows = slice(rows.start + down, rows.stop + down)
    from_columns = slice(columns.start + right, columns.stop + right)
    out[rows, columns] = values[from_rows, from_columns]
    return out


def _solve(
    inverse: np.ndarray, a: np.ndarray, b: np.ndarray, c: np.ndarray, limit: np.ndarray, radius: int
) -> LocalPlanes:
    """Least squares over the window's pixels whose inverse depth is within `limit` of the plane (a, b, c)."""
    rows, columns = np.nonzero(inverse > 0)
    padded = np.pad(inverse, radius)
    width = padded.shape[1]
    place = (rows + radius) * width + columns + radius
    flat = padded.ravel()
    a0, b0, c0, limit0 = (x[rows, columns] for x in (a, b, c, limit))
    s = np.zeros((10, len(rows)))
    for down in range(-radius, radius + 1):
        for right in range(-radius, radius + 1):
            other = flat[place + (down * width + right)]
            delta = other - c0
            near = ((other > 0) & (np.abs(delta - a0 * right - b0 * down) < limit0)).astype(np.float64)
            delta *= near
            s[:6] += near * np.array([1, right, down, right * right, right * down, down * down])[:, None]
            s[6:9] += delta * np.array([1, right, down])[:, None]
            s[9] += delta * delta
    sums = {}
    for name, values in zip(("n", "x", "y", "xx", "xy", "yy", "w", "xw", "yw", "ww"), s, strict=True):
        sums[name] = np.zeros_like(inverse)
        sums[name][rows, columns] = values
    return _planes(sums, inverse, c)


def _planes(s: dict[str, np.ndarray], inverse: np.ndarray, c: np.ndarray) -> LocalPlanes:
    n = np.maximum(s["n"], 1.0)
    mx, my, mw = s["x"] / n, s["y"] / n, s["w"] / n
    xx, xy, yy = s["xx"] / n - mx * mx, s["xy"] / n - mx * my, s["yy"] / n - my * my
    xw, yw, ww = s["xw"] / n - mx * mw, s["yw"] / n - my * mw, s["ww"] / n - mw * mw
    determinant = xx * yy - xy * xy
    solid = (s["n"] >= 6) & (determinant > 1e-3) & (inverse > 0)
    safe = np.where(solid, determinant, 1.0)
    a = np.where(solid, (xw * yy - yw * xy) / safe, 0.0)
    b = np.where(solid, (yw * xx - xw * xy) / safe, 0.0)
    level = np.where(solid, c + mw - a * mx - b * my, 0.0)
    variance = np.maximum(ww - a * xw - b * yw, 0.0)
    return LocalPlanes(a, b, level, np.sqrt(variance), np.where(solid, s["n"], 0.0))

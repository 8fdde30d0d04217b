"""The photometric terms of scene alignment (the paper's Eq. 1): colours and structural similarity over valid pixels.

The rendered picture moves with its surfaces: a pixel's colour changes by minus its gradient times the flow of the
rendered depth (Lucas and Kanade, 1981). This derivative is exact except at edges of surfaces and for view-dependent
light, and requires only colours and depth from a renderer.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.geometry.cameras import backproject
from dextera_build.geometry.scene_pose import flow
from dextera_build.geometry.scene_terms import CELLS, Terms, Weights, by_cell, cell_of, runs

RADIUS_PX, SIGMA_PX = 5, 1.5
"""Window of SSIM (Wang et al. 2004), 11 x 11 [px]."""
STEADY = (0.01**2, 0.03**2)
"""Constants of SSIM for values 0..1."""
SOLID = 0.5
"""Opacity below which G is not visible."""


@dataclass(frozen=True)
class Drawn:
    """Rendering of G by a camera."""

    rgb: np.ndarray  # (H, W, 3) 0..1
    depth: np.ndarray  # (H, W) image-plane z in the unit of G, 0 without a surface
    opacity: np.ndarray  # (H, W) 0..1

    @property
    def solid(self) -> np.ndarray:
        """Pixels (H, W) that show a surface."""
        return np.asarray((self.opacity > SOLID) & (self.depth > 0))


@dataclass(frozen=True)
class Exposure:
    """Exposure and white balance of the camera applied to a rendered colour: gain * colour + offset."""

    gain: np.ndarray  # (3,)
    offset: np.ndarray  # (3,)

    def of(self, rgb: np.ndarray) -> np.ndarray:
        """Colours (..., 3)."""
        return np.asarray(self.gain * rgb + self.offset)


SAME = Exposure(np.ones(3), np.zeros(3))


def exposure(drawn: Drawn, photo: np.ndarray, valid: np.ndarray) -> Exposure:
    """The exposure that explains the photograph best over `valid` (H, W), in two passes, the second without outliers.

    Gains are limited to 1/4 to 4, because a picture without contrast does not determine them.
    """
    gain, offset = np.ones(3), np.zeros(3)
    for channel in range(3):
        x, y = drawn.rgb[valid][:, channel], photo[valid][:, channel]
        kept = np.ones(len(x), bool)
        for _ in range(2):
            if kept.sum() < 16 or x[kept].std() < 1e-3:
                break
            middle = x[kept].mean(), y[kept].mean()
            slope = float(((x[kept] - middle[0]) * (y[kept] - middle[1])).mean() / x[kept].var())
            gain[channel] = np.clip(slope, 0.25, 4.0)
            offset[channel] = middle[1] - gain[channel] * middle[0]
            off = np.abs(gain[channel] * x + offset[channel] - y)
            kept = off < 3 * max(float(np.median(off)), 1e-3)
    return Exposure(gain, offset)


def photometric(
    drawn: Drawn, photo: np.ndarray, valid: np.ndarray, k: np.ndarray, weights: Weights, unit: float, light: Exposure
) -> Terms:
    """lambda_rgb |I - I^R|^2 + lambda_ssim (1 - SSIM), both means over Omega: `valid` where G shows a surface.

    SSIM is evaluated where its whole window is in Omega. Means do not depend on the size of Omega.

    Args:
        drawn: G from the camera's pose, the rendered I.
        photo: (H, W, 3) I^R, 0..1.
        valid: (H, W) usable pixels of the photograph.
        k: (3, 3) intrinsics [px].
        weights: See `Weights`.
        unit: Length of a unit of shift in G.
        light: Exposure of the photograph relative to G.
    """
    omega = eroded(valid & drawn.solid, 1)
    made = np.where(omega[..., None], light.of(drawn.rgb), photo)
    slope, weight = np.zeros(made.shape), np.zeros(made.shape)
    value = _squares(made, photo, omega, weights.rgb, slope, weight)
    value += _structure(made, photo, eroded(omega, RADIUS_PX), weights.ssim, slope, weight)
    there = omega & (slope != 0).any(axis=-1)
    moves, slope, weight = _motion(drawn, light, k, unit, there), slope[there], weight[there]
    rows, columns = np.nonzero(there)
    where = cell_of(np.stack([columns, rows], axis=1), omega.shape)
    cells = np.zeros((CELLS[0] * CELLS[1], 7))
    cells[:, :6] = by_cell(np.einsum("nc,ncj->nj", slope, moves), where)
    bends = np.zeros((len(cells), 7, 7))
    for cell, some in runs(where):
        flat = moves[some].reshape(-1, 6)
        bends[cell, :6, :6] = flat.T @ (weight[some].reshape(-1, 1) * flat)
    return Terms(value, cells.sum(axis=0), bends.sum(axis=0), cells, bends)


def _squares(
    made: np.ndarray, photo: np.ndarray, omega: np.ndarray, share: float, slope: np.ndarray, weight: np.ndarray
) -> float:
    """Mean squared difference; adds its derivatives to `slope` and `weight` (H, W, 3)."""
    count = 3 * max(int(omega.sum()), 1)
    apart = (made - photo) * omega[..., None]
    slope += 2 * share / count * apart
    weight += 2 * share / count * omega[..., None]
    return share / count * float((apart**2).sum())


def _structure(
    made: np.ndarray, photo: np.ndarray, inside: np.ndarray, share: float, slope: np.ndarray, weight: np.ndarray
) -> float:
    """1 - mean SSIM; `weight` takes its second derivative at equal pictures, an upper bound elsewhere."""
    if not share or not inside.any():
        return share
    count = 3 * int(inside.sum())
    within = inside[..., None]
    mean, other = _window(made), _window(photo)
    square, both, second = _window(made * made), _window(made * photo), _window(photo * photo)
    a1, a2 = 2 * mean * other + STEADY[0], 2 * (both - mean * other) + STEADY[1]
    b1 = mean**2 + other**2 + STEADY[0]
    b2 = square - mean**2 + second - other**2 + STEADY[1]
    alike = a1 * a2 / (b1 * b2)
    to_both = np.where(within, 2 * a1 / (b1 * b2), 0.0)
    to_square = np.where(within, -alike / b2, 0.0)
    to_mean = 2 * other * (a2 - a1) / (b1 * b2) - 2 * mean * alike * (1 / b1 - 1 / b2)
    to_made = _window(np.where(within, to_mean, 0.0)) + photo * _window(to_both) + 2 * made * _window(to_square)
    slope -= share / count * to_made
    weight += 2 * share / count * _window(np.where(within, 1 / b2, 0.0))
    return share * (1 - float(alike[inside].mean()))


def _motion(drawn: Drawn, light: Exposure, k: np.ndarray, unit: float, there: np.ndarray) -> np.ndarray:
    """(N, 3, 6): change of the colours of the pixels `there` with a step; 0 at edges of G."""
    bright = drawn.rgb * light.gain
    inner = eroded(drawn.solid, 1)[there][:, None]
    down, across = (np.gradient(bright, axis=axis)[there] * inner for axis in (0, 1))
    moves = flow(backproject(np.where(drawn.solid, drawn.depth, unit), k)[there], k, unit)[..., :6]
    return -np.asarray(across[..., None] * moves[:, None, 0, :] + down[..., None] * moves[:, None, 1, :])


def _window(pictures: np.ndarray) -> np.ndarray:
    """Pictures (H, W, 3) under the window of SSIM."""
    import cv2

    side = 2 * RADIUS_PX + 1
    return np.asarray(cv2.GaussianBlur(pictures, (side, side), SIGMA_PX, borderType=cv2.BORDER_CONSTANT))


def eroded(mask: np.ndarray, reach: int) -> np.ndarray:
    """Pixels (H, W) whose square of `reach` to all sides is inside the mask and the picture."""
    import cv2

    square = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    left = cv2.erode(mask.view(np.uint8), square, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    return np.asarray(left > 0)

"""Check of the registration of depth to colour: their edges must coincide."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

REACH = 40
"""Largest shift that is searched [px of the reduced image]."""
WIDTH = 640
"""Larger images are reduced by a whole factor to about this width [px]."""
SLACK = 4
"""Tolerance for edges displaced by depth cameras [px]."""
FEWEST = 400
"""Minimum number of pixels at depth edges."""
CLEARLY = 2.0
"""Minimum gain in agreement by the shift, in standard deviations over all shifts: correct captures had up to 0.4,
captures with depth shifted by 10 px or more at least 2.8."""
MATCH = 0.25
"""Smallest agreement of a match; correct captures had 0.27 to 1.4, a textureless picture has none."""
JUMP = 0.03
"""Relative difference of depth across an edge."""


class Shift(NamedTuple):
    """Shift of the depth's edges relative to the colours' edges."""

    right: int
    """[px]."""
    down: int
    """[px]."""


def shift(pixels: np.ndarray, depth: np.ndarray) -> Shift | None:
    """The shift of the depth; None if edges coincide, or if there are too few.

    Args:
        pixels: (H, W, 3) uint8.
        depth: (H, W) [m], 0 if not measured.
    """
    factor = max(1, round(pixels.shape[1] / WIDTH))
    jumps = _jumps(depth[::factor, ::factor])
    count = sum(float(each.sum()) for each in jumps)
    if count < FEWEST or min(jumps[0].shape) <= 2 * REACH:
        return None
    colours = _steps(pixels[::factor, ::factor])
    agreement = (_correlation(colours[0], jumps[0]) + _correlation(colours[1], jumps[1])) / count
    row, column = np.unravel_index(int(agreement.argmax()), agreement.shape)
    middle = slice(REACH - SLACK, REACH + SLACK + 1)
    gain = float(agreement.max() - agreement[middle, middle].max())
    if agreement.max() < MATCH or gain < CLEARLY * float(agreement.std()):
        return None
    return Shift(-factor * (int(column) - REACH), -factor * (int(row) - REACH))


def _jumps(depth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (H, W) float32 across which the depth jumps along x and along y."""
    found = []
    for z in (depth, depth.T):
        near, far = z[:, :-6], z[:, 6:]
        low, high = np.minimum(near, far), np.maximum(near, far)
        jump = np.zeros(z.shape, np.float32)
        jump[:, 3:-3] = (low > 0) & (high - low > JUMP * low + 0.005)
        found.append(jump)
    return found[0], np.ascontiguousarray(found[1].T)


def _steps(pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Steps of colour (H, W) along x and along y, relative to their surroundings, to suppress textures."""
    from scipy import ndimage

    soft = ndimage.gaussian_filter(pixels.astype(np.float32), (1.5, 1.5, 0))
    found = []
    for axis in (1, 0):
        step = np.abs(np.gradient(soft, axis=axis)).max(axis=-1) * 2.0
        mean = ndimage.uniform_filter(step, 31)
        spread = np.sqrt(np.maximum(ndimage.uniform_filter(step * step, 31) - mean * mean, 0.0)) + 3.0
        found.append(np.clip((step - mean) / spread, -1.0, 4.0))
    return found[0], found[1]


def _correlation(colour: np.ndarray, jumps: np.ndarray) -> np.ndarray:
    """Sum of the colours' steps at the depth's jumps, for each shift (2 REACH + 1, 2 REACH + 1) of the depth."""
    from scipy import ndimage

    size = (colour.shape[0] + 2 * REACH, colour.shape[1] + 2 * REACH)
    both = np.fft.rfft2(colour, size) * np.conj(np.fft.rfft2(jumps, size))
    shifts = np.arange(-REACH, REACH + 1)
    return np.asarray(ndimage.gaussian_filter(np.fft.irfft2(both, size)[np.ix_(shifts, shifts)], 1.0))

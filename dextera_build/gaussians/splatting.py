"""Pictures of 3D Gaussians on the CPU, for previews and tests: the forward pass of Kerbl et al. 2023 in NumPy.

The projection is that of EWA splatting (Zwicker et al. 2001) with the constants of the authors' renderer: a low-pass of
0.3 px^2, opacities in a pixel of at most 0.99, nothing below 1/255.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dextera_build.gaussians import arrays as shapes
from dextera_build.gaussians.arrays import Gaussians
from dextera_build.geometry.cameras import look_at

_LOW_PASS_PX2 = 0.3
_LEAST, _MOST = 1 / 255, 0.99
"""Opacities in one pixel: lower ones are skipped, higher ones are clipped."""
_WIDEST = 1.3
"""Limit of the directions of linearisation, as a multiple of half the field of view."""
_PAIRS = 2_000_000
"""Maximum number of pairs of a Gaussian and a pixel in memory."""
_PREVIEW = 100_000
"""Maximum number of Gaussians in a preview."""
_SIZE = (240, 320)
"""Rows and columns of a preview [px]."""


def render(
    gaussians: Gaussians,
    k: np.ndarray,
    world_from_camera: np.ndarray,
    size: tuple[int, int],
    *,
    paper: float | np.ndarray = 0.0,
    paper_m: np.ndarray | None = None,
    near_m: float = 0.01,
) -> np.ndarray:
    """The picture that a camera sees, (H, W, 3) float64, sRGB.

    Args:
        gaussians: In the world frame.
        k: (3, 3) intrinsics, integer pixel centres [px].
        world_from_camera: (4, 4) T_world_camera, OpenCV axes.
        size: Rows and columns [px].
        paper: Background in sRGB: one grey, or (H, W, 3).
        paper_m: (H, W) image-plane depth of the background [m], inf where it is behind all; it hides farther means.
        near_m: Smallest depth of a drawn mean [m].
    """
    rows, columns = size
    flat = _project(gaussians, k, world_from_camera, size, near_m)
    light, colour = np.ones(rows * columns), np.zeros((rows * columns, 3))
    for chunk in _chunks(flat.areas):
        _blend(flat, chunk, columns, light, colour, None if paper_m is None else paper_m.ravel())
    return np.asarray(colour.reshape(rows, columns, 3) + paper * light.reshape(rows, columns, 1))


def preview(gaussians: Gaussians) -> np.ndarray:
    """The Gaussians from their front left and above, (240, 320, 3) uint8 on white.

    At most the 100,000 largest are drawn; the view is fitted to the middle 96 % of them along each axis.
    """
    if not len(gaussians):
        return np.full((*_SIZE, 3), 255, np.uint8)
    if len(gaussians) > _PREVIEW:
        cover = gaussians.opacities * np.sort(gaussians.scales, axis=1)[:, 1:].prod(axis=1)
        gaussians = gaussians[np.sort(np.argsort(-cover, kind="stable")[:_PREVIEW])]
    low, high = np.quantile(gaussians.means, [0.02, 0.98], axis=0)
    reach = max(float(np.linalg.norm(high - low)) / 2, 3 * float(np.median(gaussians.scales)), 1e-12)
    middle = (low + high) / 2
    view = np.array([-0.6, -0.8, 0.55])
    # A multiple of the extent makes the picture independent of scale; `look_at` needs lengths that are not tiny.
    unit = shapes.moved(gaussians, np.eye(4), 1 / reach)
    pose = look_at(middle / reach + 3 * view / np.linalg.norm(view), middle / reach)
    focal = 1.4 * min(_SIZE)
    k = np.array([[focal, 0, (_SIZE[1] - 1) / 2], [0, focal, (_SIZE[0] - 1) / 2], [0, 0, 1]])
    return np.asarray(np.round(255 * render(unit, k, pose, _SIZE, paper=1.0).clip(0, 1)).astype(np.uint8))


class _Flat:
    """Gaussians projected to the picture, sorted by depth."""

    def __init__(self, places: np.ndarray, conics: np.ndarray, boxes: np.ndarray, opacities: np.ndarray) -> None:
        self.centres, self.depths = places[:, :2], places[:, 2]  # (N, 2) column and row [px], (N,) [m]
        self.conics = conics  # (N, 3) xx, xy, yy of the inverse covariance [1/px^2]
        self.low, self.spans = boxes  # (N, 2) each, first pixel and number of pixels along columns and rows
        self.opacities = opacities  # (N,)
        self.areas = self.spans.prod(axis=1)
        self.colours = np.zeros((len(places), 3))


def _project(gaussians: Gaussians, k: np.ndarray, pose: np.ndarray, size: tuple[int, int], near: float) -> _Flat:
    turn, eye = pose[:3, :3], pose[:3, 3]
    places = (gaussians.means - eye) @ turn
    seen = np.flatnonzero((places[:, 2] > near) & (gaussians.opacities >= _LEAST))
    seen = seen[np.argsort(places[seen, 2], kind="stable")]
    kept, (x, y, z) = gaussians[seen], places[seen].T
    centres = np.stack([k[0, 0] * x / z + k[0, 2], k[1, 1] * y / z + k[1, 2]], axis=1)
    spread = _spread(kept, k, turn, np.stack([x / z, y / z], axis=1), z, size)
    xx, xy, yy = spread
    determinant = xx * yy - xy * xy
    conics = np.stack([yy, -xy, xx], axis=1) / determinant[:, None]
    reach = np.sqrt(2 * np.log(kept.opacities / _LEAST)[:, None] * np.stack([xx, yy], axis=1))
    most = np.array([size[1] - 1, size[0] - 1])
    low = np.clip(np.ceil(centres - reach), 0, most + 1).astype(np.int64)
    high = np.clip(np.floor(centres + reach), -1, most).astype(np.int64)
    placed = np.concatenate([centres, z[:, None]], axis=1)
    flat = _Flat(placed, conics, np.stack([low, np.maximum(high - low + 1, 0)]), kept.opacities)
    flat.colours = shapes.colours(kept, eye)
    return flat


def _spread(
    gaussians: Gaussians, k: np.ndarray, turn: np.ndarray, slope: np.ndarray, z: np.ndarray, size: tuple[int, int]
) -> np.ndarray:
    """Covariances (3, N) xx, xy, yy on the picture [px^2]; `slope` (N, 2) is x/z, y/z."""
    focal = np.array([k[0, 0], k[1, 1]])
    limit = _WIDEST * np.array([size[1], size[0]]) / 2 / focal
    slope = np.clip(slope, -limit, limit)
    jacobian = np.zeros((len(z), 2, 3))
    jacobian[:, 0, 0], jacobian[:, 1, 1] = focal[0] / z, focal[1] / z
    jacobian[:, :, 2] = -focal * slope / z[:, None]
    across = jacobian @ turn.T
    flat = across @ shapes.covariances(gaussians) @ across.transpose(0, 2, 1)
    return np.stack([flat[:, 0, 0] + _LOW_PASS_PX2, flat[:, 0, 1], flat[:, 1, 1] + _LOW_PASS_PX2])


def _chunks(areas: np.ndarray) -> Iterator[slice]:
    """Runs of Gaussians with about `_PAIRS` pixels each."""
    ends = np.cumsum(areas)
    start = 0
    while start < len(areas):
        done = ends[start - 1] if start else 0
        stop = max(int(np.searchsorted(ends, done + _PAIRS, side="right")), start + 1)
        yield slice(start, stop)
        start = stop


def _blend(
    flat: _Flat, chunk: slice, columns: int, light: np.ndarray, colour: np.ndarray, limit: np.ndarray | None
) -> None:
    """Blend a run of Gaussians behind the existing ones; `light` (H W,) is the transmittance, `colour` (H W, 3).

    Gaussians farther than `limit` (H W,) are skipped.
    """
    areas = flat.areas[chunk]
    owner = np.repeat(np.arange(chunk.start, chunk.stop), areas)
    place = np.arange(len(owner)) - np.repeat(np.cumsum(areas) - areas, areas)
    column = flat.low[owner, 0] + place % flat.spans[owner, 0]
    row = flat.low[owner, 1] + place // flat.spans[owner, 0]
    dx, dy = column - flat.centres[owner, 0], row - flat.centres[owner, 1]
    xx, xy, yy = flat.conics[owner].T
    alpha = np.minimum(flat.opacities[owner] * np.exp(-0.5 * (xx * dx * dx + yy * dy * dy) - xy * dx * dy), _MOST)
    pixel = row * columns + column
    shown = alpha >= _LEAST
    kept = np.flatnonzero(shown if limit is None else shown & (flat.depths[owner] <= limit[pixel]))
    pixel = pixel[kept]
    order = kept[np.argsort(pixel, kind="stable")]  # by pixel, and from near to far within it
    pixel, alpha, owner = np.sort(pixel, kind="stable"), alpha[order], owner[order]
    passed = np.log1p(-alpha)
    total = np.cumsum(passed)
    first = np.flatnonzero(np.r_[True, pixel[1:] != pixel[:-1]]) if len(pixel) else np.zeros(0, np.int64)
    before = total - passed
    before -= np.repeat(before[first], np.diff(np.r_[first, len(pixel)]))
    weight = light[pixel] * np.exp(before) * alpha
    for channel in range(3):
        colour[:, channel] += np.bincount(pixel, weight * flat.colours[owner, channel], len(colour))
    light *= np.exp(np.bincount(pixel, passed, len(light)))

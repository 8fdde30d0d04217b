"""Fill holes of a flat, textured surface from its own surroundings.

The picture is split into a smooth part, which holds light and shadow, and a detail part. The smooth part is
interpolated across the hole as a membrane; the detail is quilted from patches that match the surroundings of each tile
(after Efros and Freeman 2001). Wood grain and seams continue, without steps in brightness.
"""

from __future__ import annotations

import cv2
import numpy as np

MOST_TILES = 120
COARSER = 1.2
"""Maximum ratio of the coarseness of source to target."""
SHRINK = 4
"""Downscaling factor of the coarse search."""
TINTS = 1.2
"""Largest tint of a patch, relative to that below which 90 % of the surface are."""
MOST_CONTRAST = 1.6
"""Largest factor by which the contrast of a patch is raised or lowered."""
CONTRAST = 0.5
"""Penalty on a difference in contrast, relative to the correlation."""
COLOUR = 0.02
"""Penalty per grey level of difference in the smooth colour: another colour is another material."""


def membrane(values: np.ndarray, known: np.ndarray) -> np.ndarray:
    """`values` (H, W, C) float32 with everything outside `known` (H, W) interpolated smoothly (push-pull pyramid)."""
    weight = known.astype(np.float32)[..., None]
    if min(known.shape) <= 2 or known.all():
        total = max(float(weight.sum()), 1e-6)
        mean = (values * weight).sum(axis=(0, 1)) / total
        return np.where(known[..., None], values, mean).astype(np.float32)
    size = ((known.shape[1] + 1) // 2, (known.shape[0] + 1) // 2)
    less = cv2.resize(values * weight, size, interpolation=cv2.INTER_AREA).reshape(size[1], size[0], -1)
    part = cv2.resize(weight, size, interpolation=cv2.INTER_AREA).reshape(size[1], size[0], 1)
    coarse = membrane((less / np.maximum(part, 1e-6)).astype(np.float32), part[..., 0] > 1e-3)
    back = cv2.resize(coarse, known.shape[::-1], interpolation=cv2.INTER_LINEAR).reshape(values.shape)
    filled = np.where(known[..., None], values, back).astype(np.float32)
    # A few relaxation sweeps remove the pyramid's blocks.
    kept, mask = values.astype(np.float32), known.astype(np.uint8)
    for _ in range(8):
        filled = cv2.copyTo(kept, mask, cv2.blur(filled, (3, 3)))
    return filled.reshape(values.shape)


def smooth_part(image: np.ndarray, known: np.ndarray, sigma: float) -> np.ndarray:
    """Gaussian mean (H, W, 3) of the known pixels, extended elsewhere as a membrane; `sigma` in pixels."""
    weight = cv2.GaussianBlur(known.astype(np.float32), (0, 0), sigma)[..., None]
    mean = cv2.GaussianBlur(image * known[..., None].astype(np.float32), (0, 0), sigma).reshape(image.shape)
    return membrane(mean / np.maximum(weight, 1e-4), known)


def fill_texture(
    image: np.ndarray,
    hole: np.ndarray,
    source: np.ndarray,
    blur: np.ndarray,
    sigma: float = 12.0,
    context: np.ndarray | None = None,
    edge: np.ndarray | None = None,
) -> np.ndarray:
    """Fill `hole` of a flat texture.

    Args:
        image: (H, W, 3) float32, 0..255.
        hole: (H, W) pixels to fill.
        source: (H, W) allowed sources of texture.
        blur: (H, W) local coarseness in any unit; much coarser sources are avoided.
        sigma: Scale that separates the smooth part from detail [px].
        context: (H, W) pixels whose colour and grain the fill continues, which contain `source`; None: `source`.
        edge: (H, W) pixels whose mean colour along the border of the hole is that of the fill; None: `context`.

    Returns:
        (H, W, 3) float32; pixels outside `hole` are unchanged.
    """
    if not hole.any() or source.sum() < 100:
        return image
    context = source if context is None else context
    smooth = smooth_part(image, context, sigma)
    detail = np.where(context[..., None], image - smooth, 0.0).astype(np.float32)
    detail = _own_tints(detail, context)
    traits = np.concatenate([smooth, blur[..., None]], axis=-1)
    quilted = _quilt(detail, hole, context & ~hole, source & ~hole, traits)
    quilted = quilted * _contrast(detail, quilted, context & ~hole, sigma)
    light = smooth if edge is None else smooth_part(image, edge, sigma)
    return np.where(hole[..., None], light + quilted, image).astype(np.float32)


def _own_tints(detail: np.ndarray, context: np.ndarray) -> np.ndarray:
    """Detail without tints that the surface has hardly anywhere, such as the reflection of a red carton."""
    grey = detail.mean(axis=-1, keepdims=True)
    tint = detail - grey
    most = TINTS * np.quantile(np.abs(tint[context]), 0.9, axis=0)
    return np.asarray(grey + np.clip(tint, -most, most), np.float32)


def _contrast(detail: np.ndarray, quilted: np.ndarray, source: np.ndarray, sigma: float) -> np.ndarray:
    """Factor (H, W, 1) that gives quilted detail the contrast of the detail around the hole.

    Patches from farther away are softer, and a soft patch beside sharp grain shows where the hole was.
    """
    wanted = smooth_part(np.square(detail).mean(axis=-1, keepdims=True), source, 2 * sigma)
    made = cv2.GaussianBlur(np.square(quilted).mean(axis=-1), (0, 0), 2 * sigma)[..., None]
    ratio = np.sqrt((wanted.reshape(made.shape) + 1.0) / (made + 1.0))
    return np.asarray(np.clip(ratio, 1.0 / MOST_CONTRAST, MOST_CONTRAST))


def _quilt(
    detail: np.ndarray, hole: np.ndarray, context: np.ndarray, source: np.ndarray, traits: np.ndarray
) -> np.ndarray:
    """Detail for the hole, which continues that of `context`, of patches from `source`.

    `traits` (H, W, 4) are the smooth colour and the coarseness of each pixel.
    """
    tile = 2 * SHRINK * max(3, round(float(np.sqrt(hole.sum() / MOST_TILES)) / 2 / SHRINK))
    reach = tile // 2
    window = tile + 2 * reach
    # Pad to a multiple of the coarse search's step.
    rim = tuple((window, window + -n % SHRINK) for n in detail.shape[:2])
    work = np.pad(detail, (*rim, (0, 0)))
    open_, known = np.pad(hole, rim), np.pad(context, rim)
    traits = np.pad(traits, (*rim, (0, 0)), mode="edge")
    search = _Search(work, np.pad(source, rim), traits, window)
    fixed = known.copy()
    corners = np.array(_tiles(open_, tile))
    counts = np.array([np.count_nonzero(known[_box(corner, reach, window)]) for corner in corners])
    for _ in corners if search.possible else ():
        chosen = int(np.argmax(counts))
        corner = corners[chosen]
        area = _box(corner, reach, window)
        patch = search.best(work[area], known[area], np.median(traits[area], axis=(0, 1)))
        fresh = open_[area] & ~fixed[area]
        blend = _feather(known[area], reach)[..., None]
        work[area] = np.where(fresh[..., None], work[area] * (1 - blend) + patch * blend, work[area])
        known[area] |= fresh
        counts[chosen] = -1
        for near in np.flatnonzero((np.abs(corners - corner) < window).all(axis=1) & (counts >= 0)):
            counts[near] = np.count_nonzero(known[_box(corners[near], reach, window)])
    return np.asarray(work[rim[0][0] : rim[0][0] + detail.shape[0], rim[1][0] : rim[1][0] + detail.shape[1]])


class _Search:
    """Finds windows of known texture: a coarse global search, then a fine one around the best match."""

    def __init__(self, texture: np.ndarray, known: np.ndarray, traits: np.ndarray, window: int) -> None:
        self._texture = texture.copy()
        self._window = window
        self._grey = texture.mean(axis=-1)
        self._small = _shrunk(self._grey)
        # Valid upper left corners of complete source windows.
        ones = np.ones((window, window), np.uint8)
        free = cv2.erode(known.astype(np.uint8), ones, anchor=(0, 0), borderValue=0) > 0
        rows, columns = (n - window + 1 for n in known.shape)
        self._free = free[:rows, :columns]
        side = window // SHRINK
        rows, columns = (n - side + 1 for n in self._small.shape)
        self._coarse = _thinned(self._free)[:rows, :columns]
        self._places = np.argwhere(self._coarse)
        middle = _thinned(traits[window // 2 :, window // 2 :])[:rows, :columns][self._coarse]
        self._colour, self._blur = middle[:, :3], middle[:, 3]
        square, mean = (
            cv2.boxFilter(p, -1, (side, side), anchor=(0, 0))[:rows, :columns] for p in (self._small**2, self._small)
        )
        self._spread = np.sqrt(np.maximum(square - mean**2, 0.0))[self._coarse]
        self.possible = len(self._places) > 0

    def best(self, target: np.ndarray, context: np.ndarray, traits: np.ndarray) -> np.ndarray:
        """The window that best matches `target` within `context`, from a location with similar `traits` (4,)."""
        grey = target.mean(axis=-1)
        cost = self._cost(_shrunk(grey), _thinned(context))
        apart = np.abs(self._colour - traits[:3])
        cost = cost + COLOUR * ((apart[:, 0] + apart[:, 1] + apart[:, 2]) / 3)
        most = COARSER * max(float(traits[3]), float(self._blur.min()))
        cost = np.where(self._blur <= most, cost, np.inf)
        row, column = (SHRINK * int(n) for n in self._places[int(np.argmin(cost))])
        row, column = self._refined(row, column, grey, context)
        return np.asarray(self._texture[row : row + self._window, column : column + self._window])

    def _cost(self, wanted: np.ndarray, context: np.ndarray) -> np.ndarray:
        if context.sum() < 4:
            return np.zeros(len(self._places))
        # Correlation, because least squares favours flat patches.
        fit = _correlation(self._small, wanted, context)[: self._coarse.shape[0], : self._coarse.shape[1]]
        fit = fit[self._coarse]
        spread = float(np.std(wanted[context]))
        return np.asarray(CONTRAST * np.abs(np.log((self._spread + 1.0) / (spread + 1.0))) - fit)

    def _refined(self, row: int, column: int, grey: np.ndarray, context: np.ndarray) -> tuple[int, int]:
        top, left = max(0, row - SHRINK), max(0, column - SHRINK)
        free = self._free[top : row + SHRINK + 1, left : column + SHRINK + 1]
        if context.sum() < 4:
            return row, column
        area = self._grey[top : top + free.shape[0] + self._window - 1, left : left + free.shape[1] + self._window - 1]
        fit = np.where(free, _correlation(area, grey, context), -np.inf)
        down, right = np.unravel_index(int(np.argmax(fit)), fit.shape)
        return top + int(down), left + int(right)


def _correlation(picture: np.ndarray, wanted: np.ndarray, context: np.ndarray) -> np.ndarray:
    """Normalised correlation of `wanted`, within `context`, with every location of `picture`, -1..1."""
    fit = cv2.matchTemplate(picture, wanted, cv2.TM_CCOEFF_NORMED, mask=context.astype(np.float32))
    return np.asarray(np.clip(np.nan_to_num(fit, nan=-1.0, posinf=-1.0), -1.0, 1.0))


def _shrunk(picture: np.ndarray) -> np.ndarray:
    scale = 1.0 / SHRINK
    return np.asarray(cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.float32)


def _thinned(picture: np.ndarray) -> np.ndarray:
    return np.asarray(picture[::SHRINK, ::SHRINK])


def _tiles(hole: np.ndarray, tile: int) -> list[tuple[int, int]]:
    rows, columns = np.nonzero(hole)
    found = []
    for top in range(int(rows.min()), int(rows.max()) + 1, tile):
        for left in range(int(columns.min()), int(columns.max()) + 1, tile):
            if hole[top : top + tile, left : left + tile].any():
                found.append((top, left))
    return found


def _box(corner: tuple[int, int], reach: int, window: int) -> tuple[slice, slice]:
    top, left = corner[0] - reach, corner[1] - reach
    return slice(top, top + window), slice(left, left + window)


def _feather(overlap: np.ndarray, reach: int) -> np.ndarray:
    """Weight of the new patch in its overlap with older ones: 0 at the window's rim, 1 inside."""
    rows, columns = np.indices(overlap.shape)
    height, width = overlap.shape
    rim = np.minimum.reduce([rows, columns, height - 1 - rows, width - 1 - columns])
    return np.where(overlap, np.clip(rim / max(reach, 1), 0.0, 1.0), 1.0).astype(np.float32)

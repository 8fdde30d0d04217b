"""Covariance of a registration: pose and scale of a rigid model from depth and outline of one view.

Errors of neighbouring pixels are correlated, because a depth camera matches windows and because a wrong shape is wrong
over whole regions. The correlation area is estimated from the residuals; that many pixels count as one measurement.
"""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import lie, planes, transforms, uncertainty
from dextera_build.geometry.registration import ScaledPose

from .model_view import Compared, ModelView

WINDOW_PX = 3.0
"""Minimum width of the area of correlated depth errors [px]: the matching window of a stereo camera."""
OUTLINE_PX = 1.0
"""Standard deviation of a mask's border, and of a common offset of all of it [px]."""
OUTLINE_ALIKE_PX = 10.0
"""Correlation length of errors along a mask's border [px]."""
GRAZING = 0.15
"""Cosine between normal and line of sight below which a depth carries no information on the surface."""
STEP_PX, STEP = 3.0, 0.03
"""Depth is ignored within this distance of a depth step [px], and relative height of such a step."""
LEAST = 0.2
"""Minimum fraction of pixels that must remain; thin objects consist of borders only."""
FARTHEST = 5.0
"""Number of standard deviations at which residuals are clipped: flying pixels, and depth of other objects."""
ANY_TURN = float(np.pi / np.sqrt(3.0))
"""Standard deviation of an unknown rotation [rad]."""


def covariance(
    model: ModelView, placed: ScaledPose, size_m: float, scale_sigma: float, freedom: np.ndarray
) -> np.ndarray:
    """Covariance (7, 7) of translation [m], rotation vector [rad] and log scale, in the axes of the world.

    Args:
        model: The model in front of the camera.
        placed: Its placement.
        size_m: Size of the placed model, the prior standard deviation of its position [m].
        scale_sigma: Prior standard deviation of the log scale.
        freedom: (7, K) basis of the changes that are possible: `lie.FREE`, `UPRIGHT` or `resting`.
    """
    step, inverse = _solved(model, placed, size_m, scale_sigma, freedom, away_from_steps=False)
    # A search may end before the optimum of depth and outline; the remaining step is added as an error.
    return np.asarray(inverse + np.outer(step, step))


def step(
    model: ModelView, placed: ScaledPose, scale_sigma: float, freedom: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The Gauss-Newton step (7,) of depth and outline, and the covariance (7, 7) without it; see `covariance`.

    Unlike there, depth at steps is not used: it is behind the nearer side and would bias the model away.
    """
    return _solved(model, placed, float("inf"), scale_sigma, freedom, away_from_steps=True)


def _solved(
    model: ModelView,
    placed: ScaledPose,
    size_m: float,
    scale_sigma: float,
    freedom: np.ndarray,
    *,
    away_from_steps: bool,
) -> tuple[np.ndarray, np.ndarray]:
    view = model.compare(placed)
    origin = placed.pose[:3, 3]
    before = np.concatenate([np.full(3, size_m), np.full(3, ANY_TURN), [scale_sigma]])
    (by_depth, depth_pull), (by_outline, outline_pull) = (
        _by_depth(view, origin, away_from_steps),
        _by_outline(view, origin),
    )
    inverse = np.linalg.pinv(freedom.T @ (np.diag(before**-2.0) + by_depth + by_outline) @ freedom)
    wide = freedom @ inverse @ freedom.T
    return np.asarray(wide @ (depth_pull + outline_pull)), np.asarray(wide)


def by_support(covariance: np.ndarray, world_from_camera: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Covariance (6, 6) of T_world_object due to that of the support in T_world_camera, both (4, 4).

    Height and tilt of an object on the support follow the support; x, y and yaw are measured by the camera, whose frame
    moves with the world's.
    """
    camera_from_object = transforms.invert(world_from_camera) @ pose
    found = uncertainty.compose(world_from_camera, camera_from_object, (covariance, np.zeros((6, 6))))
    by = np.array([0.0, 0.0, 1.0, 1.0, 1.0, 0.0])
    return np.asarray(found * np.outer(by, by))


def _by_depth(view: Compared, origin: np.ndarray, away_from_steps: bool) -> tuple[np.ndarray, np.ndarray]:
    """Information (7, 7) from the distances of the measured points along the surface normals, and its gradient (7,).

    The information times a small change is the gradient that the change would cancel.
    """
    slant = np.abs((view.normals * view.directions).sum(axis=-1))
    lengths = np.linalg.norm(view.directions, axis=-1)
    used = view.drawn & view.mask & view.known & (view.seen > 0.0) & (slant > GRAZING * lengths)
    # Depth at a step is missing, or that of a point between both sides, and always behind the nearer one.
    inside = used & ~_steps(view) if away_from_steps else used
    used = inside if inside.sum() >= LEAST * used.sum() else used
    if not used.any():
        return np.zeros((7, 7)), np.zeros(7)
    sigma = planes.depth_sigma(view.seen[used])
    residual = np.zeros(used.shape)
    residual[used] = np.clip((view.seen - view.depth)[used] / sigma, -FARTHEST, FARTHEST)
    rows = lie.point_to_plane_rows(view.points[used] - origin, view.normals[used]) / (sigma * slant[used])[:, None]
    alike = max(_alike(residual, used), (WINDOW_PX / view.stride) ** 2, 1.0)
    # Normals face the camera, so that the gradient of a larger measured depth is opposite to them.
    return np.asarray(rows.T @ rows / alike), np.asarray(-rows.T @ residual[used] / alike)


def _steps(view: Compared) -> np.ndarray:
    """Rays (h, w) bool near a step of the rendered depth."""
    from scipy import ndimage

    depth = np.where(view.drawn, view.depth, 1e3)
    width = 2 * max(1, round(STEP_PX / view.stride)) + 1
    return np.asarray(ndimage.maximum_filter(depth, width) - ndimage.minimum_filter(depth, width) > STEP * depth)


def _alike(residual: np.ndarray, used: np.ndarray) -> float:
    """Sum of the residuals' autocovariance (H, W) over all shifts up to its first small value, at least 1."""
    shape = [2 * length for length in used.shape]
    power = np.abs(np.fft.rfft2(np.where(used, residual, 0.0), shape)) ** 2
    pairs = np.abs(np.fft.rfft2(used.astype(np.float64), shape)) ** 2
    sums, counts = np.fft.irfft2(power, shape), np.round(np.fft.irfft2(pairs, shape))
    covariance = np.where(counts > 0.5, sums / np.maximum(counts, 1.0), 0.0)
    rows, columns = (np.minimum(np.arange(n), n - np.arange(n)) for n in shape)
    radius = np.round(np.hypot(rows[:, None], columns[None, :])).astype(int)
    rings = np.bincount(radius.ravel(), (covariance * counts).ravel()) / np.maximum(
        np.bincount(radius.ravel(), counts.ravel()), 1.0
    )
    small = np.flatnonzero(rings <= 0.0)
    near = radius < (small[0] if len(small) else len(rings))
    variance = max(float(covariance[0, 0]), 1.0)
    # Smooth residuals count as one measurement.
    total = float(covariance[near].sum()) / max(float(covariance[0, 0]), 1e-12)
    return variance * float(np.clip(total, 1.0, used.sum()))


def _by_outline(view: Compared, origin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Information (7, 7) from the distance of the rendered outline from the mask's border, and its gradient (7,)."""
    from scipy import ndimage

    drawn = view.drawn
    border = drawn & ~ndimage.binary_erosion(drawn, border_value=1)
    border &= ~ndimage.binary_dilation(~view.known, iterations=3)
    smooth = ndimage.gaussian_filter(drawn.astype(np.float64), 1.5)
    down, right = np.gradient(smooth)
    steep = np.hypot(right, down)
    border &= steep > 1e-3
    if not border.any() or not view.mask.any():
        return np.zeros((7, 7)), np.zeros(7)
    outward = -np.stack([right, down], axis=-1)[border] / steep[border, None]
    inside = ndimage.distance_transform_edt(view.mask) - 1.0
    off = view.stride * np.where(view.mask, inside, -ndimage.distance_transform_edt(~view.mask))[border]
    sideways = view.pixel_slopes(border, outward)
    off = np.clip(off, -FARTHEST * OUTLINE_PX, FARTHEST * OUTLINE_PX)
    variance = max(float(np.mean(off**2)), OUTLINE_PX**2)
    rows = np.column_stack([lie.point_to_plane_rows(view.points[border] - origin, sideways), np.ones(len(outward))])
    trust = view.stride / (OUTLINE_ALIKE_PX * variance)
    system, pull = rows.T @ rows * trust, rows.T @ off * trust
    system[7, 7] += OUTLINE_PX**-2.0
    # A common offset of the whole mask border is marginalised.
    offset = system[:7, 7] / system[7, 7]
    return np.asarray(system[:7, :7] - np.outer(offset, system[7, :7])), np.asarray(pull[:7] - offset * pull[7])

"""Per-pixel heights above the support, for parsing and segmentation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import planes, regions, transforms

from ..measured import Workspace

MARGIN_M = 0.03
BEYOND_M = 0.25
"""Distance by which a support continues where the picture's border cuts it [m]; see `background.outline`."""


@dataclass(frozen=True)
class Relief:
    """The capture in the world frame, with heights corrected for the support's unevenness."""

    points: np.ndarray  # (H, W, 3) float64, world [m]; meaningless where not valid
    height: np.ndarray  # (H, W) float64, above the support [m]; 0 where not valid
    valid: np.ndarray  # (H, W) bool, depth was measured
    threshold: np.ndarray  # (H, W) float64, noise bound of the height [m]
    raised: np.ndarray  # (H, W) bool, higher than the threshold
    over: np.ndarray  # (H, W) bool, above the support's outline
    continued: np.ndarray  # (H, W) bool, above the part of the support that the picture's border cuts off


def relief(seen: Workspace) -> Relief:
    """Compute heights above the support and classify pixels by them."""
    depth = seen.depth.astype(np.float64)
    valid = depth > 0
    points = seen.world_points()
    over = valid & regions.inside_convex(points[..., :2], seen.support.polygon, MARGIN_M)
    sigma = planes.depth_sigma(depth)
    height = np.where(valid, points[..., 2], 0.0)
    height -= np.where(valid, warp(height, valid & over & (np.abs(height) < 4.0 * sigma)), 0.0)
    threshold = least_height(depth)
    raised = valid & (height > threshold)
    return Relief(points, height, valid, threshold, raised, over, _continued(seen, points, raised & ~over))


def _continued(seen: Workspace, points: np.ndarray, above: np.ndarray) -> np.ndarray:
    """Pixels (H, W) bool of `above` whose foot is outside the picture, near a part of the support at its border."""
    found = np.zeros(above.shape, bool)
    feet = points[above] * [1.0, 1.0, 0.0]
    camera, pose = seen.camera, seen.world_from_camera
    at = camera.project(transforms.apply(transforms.invert(pose), feet))
    inside = np.clip(at, 0.0, [camera.width - 1.0, camera.height - 1.0])
    rays = np.column_stack([(inside - [camera.cx, camera.cy]) / [camera.fx, camera.fy], np.ones(len(inside))])
    rays = rays @ pose[:3, :3].T
    ahead = np.isfinite(rays).all(axis=1) & (rays[:, 2] < -1e-6)
    border = pose[:2, 3] + rays[:, :2] * (pose[2, 3] / np.where(ahead, -rays[:, 2], 1.0))[:, None]
    near = np.linalg.norm(border - feet[:, :2], axis=1) < BEYOND_M
    cut = (np.abs(at - inside) > 0.5).any(axis=1)
    found[above] = (
        ahead
        & cut
        & near
        & regions.inside_convex(np.where(ahead[:, None], border, 0.0), seen.support.polygon, MARGIN_M)
    )
    return found


def least_height(depth: np.ndarray) -> np.ndarray:
    """Height above the support above which a point at `depth` belongs to an object, both [m]: relief and noise."""
    return np.asarray(0.0025 + 1.8 * planes.depth_sigma(depth))


def warp(height: np.ndarray, flat: np.ndarray) -> np.ndarray:
    """Fit a cubic in image coordinates to the heights of the support's pixels; (H, W) [m].

    Args:
        height: (H, W) [m].
        flat: (H, W) bool, pixels of the support.
    """
    rows, columns = np.mgrid[0 : height.shape[0], 0 : height.shape[1]]
    u = columns / height.shape[1] - 0.5
    v = rows / height.shape[0] - 0.5
    terms = [np.ones_like(u), u, v, u * u, u * v, v * v, u**3, u * u * v, u * v * v, v**3]
    step = 3
    chosen = flat[::step, ::step]
    if chosen.sum() < 500:
        return np.zeros_like(height)
    matrix = np.stack([term[::step, ::step][chosen] for term in terms], axis=1)
    target = height[::step, ::step][chosen]
    keep = np.ones(len(target), bool)
    solution = np.zeros(len(terms))
    for _ in range(4):
        solution = np.linalg.lstsq(matrix[keep], target[keep], rcond=None)[0]
        error = target - matrix @ solution
        keep = np.abs(error) < 2.5 * max(1e-4, float(np.median(np.abs(error))) * 1.48)
    smooth = np.tensordot(solution, np.stack(terms), axes=1)
    # Beyond the seen support the polynomial may diverge.
    return np.clip(smooth, -0.006, 0.006)

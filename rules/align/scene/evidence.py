"""Evidence for and against an alignment of a scene."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.scenes.scene_fit import SceneEvidence
from dextera_build.geometry.scene_alignment import Level, Solution
from dextera_build.geometry.scene_pose import ScenePose
from dextera_build.geometry.scene_terms import Correspondences
from dextera_build.geometry.sharpness import left_by_blur

from .beginning import Start

ALIKE, BEFORE = 0.04, 0.06
"""Relative depth differences: below the first surfaces agree, above the second one occludes the other."""
GRID = (3, 4)
"""Rows and columns of the grid over which inliers should be spread."""


def evidence(start: Start, solution: Solution, level: Level, k: np.ndarray, size: tuple[int, int]) -> SceneEvidence:
    """Evidence from the picture of the last level and from the inliers."""
    assert solution.drawn is not None
    assert solution.omega is not None
    drawn, matches = solution.drawn, start.matches
    known = level.depth > 0
    both = drawn.solid & known
    ahead = (drawn.depth * solution.pose.scale / np.where(known, level.depth, 1.0) - 1.0)[both]
    across, along = residuals(solution.pose, matches, k)
    rows, columns = GRID
    cells = np.floor(matches.pixels / [size[1], size[0]] * [columns, rows]).clip(0, [columns - 1, rows - 1])
    return SceneEvidence(
        pairs=start.tried,
        inliers=len(matches),
        spread=len(np.unique(cells, axis=0)) / (rows * columns),
        overlap=float(both.sum() / max(int(known.sum()), 1)),
        agreement=float((np.abs(ahead) < ALIKE).mean()) if len(ahead) else 0.0,
        in_front=float((ahead < -BEFORE).mean()) if len(ahead) else 0.0,
        correlation=_correlation(drawn.rgb, level.rgb, solution.omega),
        residual_px=across,
        residual_m=along,
        condition=solution.condition,
    )


def residuals(pose: ScenePose, matches: Correspondences, k: np.ndarray) -> tuple[float, float]:
    """Median reprojection error of the inliers [px], and of their depths [m]."""
    seen = pose.seen(matches.anchors)
    pixel = seen[:, :2] / np.maximum(seen[:, 2:], 1e-9) * [k[0, 0], k[1, 1]] + [k[0, 2], k[1, 2]]
    known = matches.depths > 0
    apart = np.abs(pose.scale * seen[known, 2] - matches.depths[known])
    return float(np.median(np.linalg.norm(pixel - matches.pixels, axis=1))), float(np.median(apart))


def _correlation(one: np.ndarray, other: np.ndarray, where: np.ndarray) -> float:
    if int(where.sum()) < 20:
        return 0.0
    x, y = (each[where].mean(axis=1) for each in (one, other))
    x, y = x - x.mean(), y - y.mean()
    return float(x @ y / max(float(np.linalg.norm(x) * np.linalg.norm(y)), 1e-12))


def about(pixels: np.ndarray) -> dict[str, str]:
    """Properties of a photograph (H, W, 3) uint8 with few matches: its brightness and its sharpness."""
    import cv2

    grey = cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY).astype(np.float64)
    left = left_by_blur(grey)
    said = {"brightness": f"{grey.mean():.0f} of 255", "edges after a blur of 2.5 px": f"{left:.0%}"}
    if grey.mean() < DARK:
        said["dark"] = f"less than {DARK:.0f} of 255: few features can be distinguished"
    if left > BLURRED:
        said["blurred"] = f"more than {BLURRED:.0%} are left: the camera or the scene moved, or it is out of focus"
    return said


DARK, BLURRED = 25.0, 0.85
"""Mean grey value below which a photograph is dark, and fraction of edges left by a further blur above which it is
blurred."""

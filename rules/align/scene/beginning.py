"""Initial pose of a photograph in a generated scene, from points matched with rendered pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera, Capture
from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.cameras.matches import Matches
from dextera_build.geometry import cameras, transforms
from dextera_build.geometry.photo_terms import Drawn
from dextera_build.geometry.scene_alignment import Render
from dextera_build.geometry.scene_pose import ScenePose
from dextera_build.geometry.scene_terms import Correspondences

Viewpoint = tuple[np.ndarray, Drawn]
"""T_G_C (4, 4), and the rendering of the scene from there."""
Match = Callable[[Image, Image], Matches]
"""Matcher of points of a rendered picture and of the photograph."""

EDGE = 0.05
"""Relative depth difference around a point above which it is on an edge and its surface is ambiguous."""
ERROR_PX = 4.0
"""Largest reprojection error of an inlier, in a picture 640 px wide [px]."""
APART = 0.06
"""Largest relative difference between a measured depth and the rendered one at the common scale."""
LEAST = 6
"""Minimum number of points for a pose."""
ROUNDS = 3
"""Maximum number of times that the scene is rendered again from the estimated viewpoint."""
NEAR = 0.05
"""Distance from an estimated viewpoint within which it is not rendered again: in median depths, and in radians."""


@dataclass(frozen=True)
class Start:
    """A robust estimate of theta, with its inliers."""

    pose: ScenePose
    matches: Correspondences  # inliers of the pose and of one scale
    tried: int  # pairs of points with a depth in the scene
    drawn_from: np.ndarray  # (4, 4) T_G_C of the picture with the inliers


def given(capture: Capture, image: Camera, pairs: Matches, viewpoint: Viewpoint) -> Start | None:
    """The start by points of the photograph and of the picture that the scene was made from, which `image` took."""
    place, drawn = viewpoint
    return _robust(_anchored(pairs, drawn, place, capture, image), capture.photograph.camera, place)


def found(
    capture: Capture,
    render: Render,
    match: Match,
    viewpoints: Iterable[Viewpoint],
    enough: int,
    unit: float,
    best: Start | None = None,
) -> tuple[Start | None, int]:
    """The start with the most points, refined by rendering the scene from there; and the most pairs of any viewpoint.

    Args:
        capture: With depth.
        render: Renders the scene.
        match: Matches points of two pictures.
        viewpoints: Poses with their renderings, the likeliest first.
        enough: Number of points at which no further viewpoint is tried.
        unit: Median depth of the scene, in its unit.
        best: A start that is known already; with enough points, no viewpoint is tried.
    """
    pairs = 0 if best is None else best.tried
    for place, drawn in viewpoints if best is None or len(best.matches) < enough else ():
        start, tried = _seen_in(capture, drawn, match, place)
        pairs = max(pairs, tried)
        if start and (best is None or len(start.matches) > len(best.matches)):
            best = start
            if len(start.matches) >= enough:
                break
    camera = capture.photograph.camera
    for _ in range(ROUNDS if best else 0):
        assert best is not None
        place = best.pose.scene_from_camera
        if len(best.matches) >= enough and _beside(place, best.drawn_from, unit):
            break
        again, _ = _seen_in(capture, render(place, camera.matrix(), (camera.height, camera.width)), match, place)
        if again is None or len(again.matches) <= 1.05 * len(best.matches):
            if again and len(again.matches) > len(best.matches):
                best = again
            break
        best = again
    return best, pairs


def _seen_in(capture: Capture, drawn: Drawn, match: Match, place: np.ndarray) -> tuple[Start | None, int]:
    pairs = match(Image(pixels=filled(drawn)), capture.photograph.rgb)
    matches = _anchored(pairs, drawn, place, capture, capture.photograph.camera)
    return _robust(matches, capture.photograph.camera, place), len(matches)


def _beside(place: np.ndarray, other: np.ndarray, unit: float) -> bool:
    """Whether the views of two cameras T_G_C (4, 4) are nearly the same for point matching."""
    motion = transforms.invert(other) @ place
    return float(np.linalg.norm(motion[:3, 3])) < NEAR * unit and float(transforms.angle(motion[:3, :3])) < NEAR


def filled(drawn: Drawn) -> np.ndarray:
    """The picture (H, W, 3) uint8 with holes filled by surrounding colours; black ones would create corners."""
    import cv2

    there = drawn.solid.astype(np.float32)
    made, left = (drawn.rgb * there[..., None]).astype(np.float32), there == 0
    rows, columns = there.shape
    colour = made.copy()
    for sigma in (2.0, 8.0, 32.0, 128.0):
        if not left.any():
            break
        # A wide blur is sufficient at low resolution.
        size = tuple(max(1, round(2 * length / sigma)) for length in (columns, rows))
        weight, soft = (
            cv2.resize(
                cv2.GaussianBlur(cv2.resize(each, size, interpolation=cv2.INTER_AREA), (0, 0), 2.0), (columns, rows)
            )
            for each in (there, colour)
        )
        fresh = left & (weight > 1e-3)
        made[fresh] = soft[fresh] / weight[fresh, None]
        left &= ~fresh
    return np.asarray(np.round(255 * made.clip(0, 1)), np.uint8)


def _anchored(pairs: Matches, drawn: Drawn, place: np.ndarray, capture: Capture, lens: Camera) -> Correspondences:
    """Pairs whose pixel in the picture of `lens` is on a rendered surface, away from edges, with its depth in G."""
    assert capture.measured is not None
    made = sampled(np.where(drawn.solid, drawn.depth, 0.0), pairs.first)
    measured = sampled(capture.measured.depth.depth.astype(np.float64), pairs.second)
    on = made > 0
    local = cameras.directions(pairs.first[on], lens.matrix())
    anchors = transforms.apply(place, local * made[on, None])
    return Correspondences(anchors, pairs.second[on], measured[on])


def sampled(depth: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Median depth (N,) of the nine pixels at each of (N, 2); 0 if an edge or a hole is among them."""
    rows, columns = depth.shape
    column, row = np.round(pixels).astype(int).T
    inside = (column > 0) & (row > 0) & (column < columns - 1) & (row < rows - 1)
    column, row = column.clip(1, columns - 2), row.clip(1, rows - 2)
    around = np.stack([depth[row + r, column + c] for r in (-1, 0, 1) for c in (-1, 0, 1)])
    low, high = around.min(axis=0), around.max(axis=0)
    return np.asarray(np.where(inside & (low > 0) & (high - low < EDGE * high), np.median(around, axis=0), 0.0))


def _robust(matches: Correspondences, camera: Camera, place: np.ndarray) -> Start | None:
    """The pose with most inliers (LO-RANSAC), and its scale as the median ratio of measured to rendered depth."""
    import pycolmap

    if len(matches) < LEAST:
        return None
    k = camera.matrix()
    numbers = [k[0, 0], k[1, 1], k[0, 2] + 0.5, k[1, 2] + 0.5]  # pixel centres are at a half
    lens = pycolmap.Camera(model="PINHOLE", width=camera.width, height=camera.height, params=numbers)
    options = pycolmap.AbsolutePoseEstimationOptions()
    options.ransac.max_error = ERROR_PX * camera.width / 640
    options.ransac.random_seed = 0
    answer = pycolmap.estimate_and_refine_absolute_pose(matches.pixels + 0.5, matches.anchors, lens, options)
    if answer is None:
        return None
    motion = np.eye(4)
    motion[:3] = answer["cam_from_world"].matrix()
    agree = np.asarray(answer["inlier_mask"], bool)
    depth = transforms.apply(motion, matches.anchors)[:, 2]
    known = agree & (matches.depths > 0) & (depth > 0)
    if known.sum() < LEAST:
        return None
    ratio = matches.depths / np.maximum(depth, 1e-12)
    scale = float(np.median(ratio[known]))
    # A point without a measured depth still constrains the pose; one whose depth contradicts the scale is an outlier.
    agree &= (depth > 0) & ((matches.depths == 0) | (np.abs(ratio / scale - 1) < APART))
    if (agree & known).sum() < LEAST:
        return None
    return Start(ScenePose(motion, scale), matches[agree], len(matches), place)

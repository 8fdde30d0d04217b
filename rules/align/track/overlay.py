"""Outlines of tracked objects on frames of a video."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from dextera_build.artifacts.cameras.rgbd_video import RgbdVideo
from dextera_build.artifacts.objects.object import Asset
from dextera_build.geometry import kinematics, metrics, raycast, transforms
from dextera_build.tracking.tracked_object import Tracked

COLOURS = {"tracked": (40, 220, 80), "predicted": (255, 190, 40)}
"""Status -> sRGB of the outline."""


def draw(video: RgbdVideo, assets: Mapping[str, Asset], rows: Sequence[Mapping[str, Tracked]]) -> np.ndarray:
    """The first, the middle and the last frame in a row, (H, 3 W, 3) uint8."""
    last = len(rows) - 1
    numbers = [0, last // 2, last]
    frames = zip(numbers, video.frames(numbers), strict=True)
    return np.hstack([_drawn(frame.rgb, video.camera.matrix(), assets, rows[number]) for number, frame in frames])


def _drawn(rgb: np.ndarray, k: np.ndarray, assets: Mapping[str, Asset], row: Mapping[str, Tracked]) -> np.ndarray:
    pixels = rgb.copy()
    for name, asset in assets.items():
        found = row[name]
        if found.pose is None:
            continue
        named = zip((joint.name for joint in asset.body.joints), found.joints.tolist(), strict=True)
        vertices, faces = kinematics.posed_surface(asset.body, dict(named))
        surface = raycast.Surface(transforms.apply(found.pose, vertices), faces)
        seen = raycast.render([surface], k, np.eye(4), *rgb.shape[:2])
        edge = metrics.boundary(seen.index >= 0)
        thick = edge | np.roll(edge, 1, axis=0) | np.roll(edge, 1, axis=1)
        pixels[thick] = COLOURS[found.status]
    return pixels

"""Pictures of a refined calibration: the robot's outline over each picture, and residuals of arm and hand by pose."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from PIL import Image, ImageDraw

from dextera_build.artifacts.robots.robot_views import RobotViews
from dextera_build.geometry import metrics
from dextera_build.geometry.plot import COLOURS, Line, plot
from dextera_build.rule import Context

from . import overlays

if TYPE_CHECKING:
    from dextera_build.sim.render.robot_view import RobotRenderer

OUTLINES = ((40, 230, 80), (255, 140, 30))
"""Colours of the outlines of arm and hand."""


def preview(
    ctx: Context,
    views: RobotViews,
    renderer: RobotRenderer,
    camera_base: np.ndarray,
    every: int,
    residuals: dict[str, np.ndarray],
) -> None:
    """Show the model's outlines over the pictures, and the residuals."""
    assert views.joints is not None
    tiles = []
    names = list(views.captures)
    for number, name in enumerate(names[: overlays.MOST]):
        pixels = views.captures[name].photograph.rgb.pixels[::every, ::every]
        joints = dict(zip(views.joints.names, views.joints.positions[number].tolist(), strict=True))
        told = ", ".join(f"{part} {1000 * each[number]:.1f} mm" for part, each in residuals.items())
        tiles.append(outlined(pixels, renderer.view(joints, camera_base).labels, f"{name}: {told}"))
    ctx.preview(overlays.mosaic(tiles), "outline of the model: arm (green), hand (orange)")
    if residuals:
        lines = [Line(np.zeros((1, 2)), (255, 255, 255), dots=True)]
        for (_, each), colour in zip(residuals.items(), COLOURS, strict=False):
            count = np.arange(1, len(each) + 1)
            lines.append(Line(np.stack([count, 1000 * each], axis=1), colour, dots=True))
        ctx.preview(plot(lines, "pose", "[mm]"), "residuals of arm (blue) and hand (orange)")


def outlined(pixels: np.ndarray, labels: np.ndarray, text: str) -> np.ndarray:
    """A picture (H, W, 3) uint8 with outlines of labels 1 and 2 (H, W)."""
    drawn = pixels.copy()
    for number, colour in enumerate(OUTLINES, start=1):
        drawn[metrics.boundary(labels == number)] = colour
    picture = Image.fromarray(drawn)
    overlays.label(ImageDraw.Draw(picture), text)
    return np.asarray(picture)

"""What was found, over photographs: placed meshes, and the robot's outline by its calibration."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image as Pillow

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.objects.object import Body, Placement
from dextera_build.geometry import metrics
from rules.evaluate import rendered_objects

if TYPE_CHECKING:
    from .__main__ import Scenes

SHOWN = 6
"""Scenes in the picture."""
COLUMNS = 3
ROBOT, FOUND, TRUE = (30, 140, 255), (240, 40, 240), (60, 220, 60)
"""Colours of outlines."""


def save(path: Path, scenes: Scenes) -> None:
    """Outlines of the robot (blue), of placed true meshes (magenta) and of the truth (green); below, those meshes."""
    panels = [panel for label in scenes.labels if (panel := _panel(scenes, label)) is not None][:SHOWN]
    panels += [np.full_like(panels[0], 255)] * (-len(panels) % COLUMNS)
    rows = [np.concatenate(panels[start : start + COLUMNS], axis=1) for start in range(0, len(panels), COLUMNS)]
    made = Pillow.fromarray(np.concatenate(rows, axis=0))
    made.resize((made.width // 2, made.height // 2), Pillow.Resampling.LANCZOS).save(path, quality=88)


def _panel(scenes: Scenes, label: str) -> np.ndarray | None:
    photo, truth, support = (scenes.get(label, node) for node in ("photo", "truth", "twin/support"))
    robot = scenes.get(label, "robot_pixels")
    if photo is None or truth is None or support is None:
        return None
    camera = photo.photograph.camera
    drawn = {
        name: (scenes.get(label, f"unknown[{name}].asset"), scenes.get(label, f"unknown[{name}].placed"))
        for name in scenes.objects(label)
    }
    masks, colours = _seen(drawn, support, camera)
    outlined = photo.photograph.rgb.pixels.copy()
    for known in rendered_objects.true_objects(truth).values():
        outlined[metrics.boundary(known.mask)] = TRUE
    for mask in masks:
        outlined[metrics.boundary(mask)] = FOUND
    if robot is not None:
        outlined[metrics.boundary(robot.labels > 0)] = ROBOT
    twin = photo.photograph.rgb.pixels // 3
    for mask in masks:
        twin[mask] = colours[mask]
    return np.concatenate([outlined, twin], axis=0)


def _seen(
    drawn: dict[str, tuple[Body | None, Placement | None]], support: Any, camera: Any
) -> tuple[list[np.ndarray], np.ndarray]:
    """Masks (H, W) of what was placed, and its colours (H, W, 3)."""
    good = {name: (body, placed) for name, (body, placed) in drawn.items() if body is not None and placed is not None}
    bodies = Collection[Body](items={name: body for name, (body, _) in good.items()})
    placements = Collection[Placement](items={name: placed for name, (_, placed) in good.items()})
    found, colours, _ = rendered_objects.render(rendered_objects.placed_bodies(bodies, placements, support), camera)
    return [thing.mask for thing in found.values()], colours

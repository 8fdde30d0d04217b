"""The camera of a cell in a simulated world: frames with the noise of its sensor."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Self

import numpy as np

from dextera_build.artifacts.robots.cell import Cell
from dextera_build.sim.render.rendering import Eye
from dextera_build.sim.render.sensor import measure_colour, measure_depth
from dextera_build.sim.runtime.environment import Environment

Picture = tuple[np.ndarray, np.ndarray]


class CellCamera:
    """Renders from the true pose of a cell's camera; a context manager, because it holds a GL context.

    Args:
        environment: The world.
        cell: The camera.
    """

    def __init__(self, environment: Environment, cell: Cell) -> None:
        self._environment, self._cell = environment, cell
        self._held = ExitStack()

    def __enter__(self) -> Self:
        """Open the renderer."""
        pose = self._environment.bundle.base_pose.matrix @ self._cell.eye.matrix
        self.eye = self._held.enter_context(Eye(self._environment.model, self._cell.camera, pose, samples=1))
        return self

    def __exit__(self, *error: object) -> None:
        """Close it."""
        self._held.close()

    def picture(self) -> Picture:
        """Colours (H, W, 3) 0..1 and depth (H, W) [m] of the current state, without noise."""
        data = self._environment.data
        return self.eye.rgb(data) / 255.0, self.eye.depth(data).astype(np.float64)

    def measured(self, scene: Picture, random: np.random.Generator) -> Picture:
        """Colours (H, W, 3) uint8 and depth (H, W) float32 [m] as the sensor measures a picture."""
        cell = self._cell
        depth = measure_depth(scene[1], scene[0], cell.camera.matrix(), cell.depth_noise, random)
        return measure_colour(scene[0], cell.colour_noise, random), depth

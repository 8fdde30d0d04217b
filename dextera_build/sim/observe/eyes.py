"""The cameras of a task: frames with picture, depth and points, as requested."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, Literal

import numpy as np

from dextera_build.artifacts.tasks.task import View
from dextera_build.artifacts.tasks.variation import EXACT, Variation
from dextera_build.geometry import cameras, lie
from dextera_build.policy.observation import Frame, Frames
from dextera_build.sim.render import rendering

GAMMA = 2.2
"""Approximate exponent of sRGB."""

Picture = Literal["rgb", "depth", "cloud"]
"""Outputs of a camera."""


class Eyes:
    """Several cameras in one model; they hold GL contexts until they are closed.

    Args:
        model: Compiled model.
        views: Name -> camera.
        pictures: Outputs of each camera, of `Picture`; a cloud includes its depth.
    """

    def __init__(self, model: Any, views: Mapping[str, View], pictures: Collection[str]) -> None:
        self._pictures = frozenset(pictures)
        self._model, self._views = model, dict(views)
        self._lights = model.light_diffuse.copy(), model.vis.headlight.diffuse.copy()
        self._exposure = 1.0
        self._eyes = {name: rendering.through(model, view) for name, view in views.items()}
        rays = {
            name: cameras.rays(view.camera.height, view.camera.width, view.camera.matrix())
            for name, view in views.items()
        }
        self._rays = {name: each.astype(np.float32) for name, each in rays.items()}

    def vary(self, variation: Variation) -> None:
        """Apply the camera errors, light and exposure of an episode, always relative to the original values."""
        for name, eye in self._eyes.items():
            error = variation.cameras.get(name, EXACT)
            eye.look_from(lie.retract(self._views[name].camera_pose.matrix, error))
        self._model.light_diffuse[:] = self._lights[0] * variation.light
        self._model.vis.headlight.diffuse[:] = self._lights[1] * variation.light
        self._exposure = variation.exposure

    def look(self, data: Any) -> Frames:
        """Frames of the state in `data` (after `mj_forward`)."""
        return {name: self._frame(eye, self._rays[name], data) for name, eye in self._eyes.items()}

    def close(self) -> None:
        """Free the GL contexts."""
        for eye in self._eyes.values():
            eye.__exit__(None, None, None)
        self._eyes = {}

    def _frame(self, eye: rendering.Eye, rays: np.ndarray, data: Any) -> Frame:
        rgb = _exposed(eye.rgb(data), self._exposure) if "rgb" in self._pictures else None
        depth = eye.depth(data) if self._pictures & {"depth", "cloud"} else None
        cloud = depth[..., None] * rays if depth is not None and "cloud" in self._pictures else None
        return Frame(rgb, depth, cloud)


def _exposed(rgb: np.ndarray, factor: float) -> np.ndarray:
    """A picture (H, W, 3) uint8 sRGB with its linear brightness times `factor`."""
    if factor == 1.0:
        return rgb
    levels = np.clip(np.arange(256) / 255.0 * factor ** (1.0 / GAMMA), 0.0, 1.0)
    return np.asarray(np.round(255.0 * levels).astype(np.uint8)[rgb])

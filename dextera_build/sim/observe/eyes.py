"""The cameras of a task: frames with picture, depth and points, as far as they are asked for."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, Literal

import numpy as np

from dextera_build.artifacts.task import View
from dextera_build.geometry import cameras
from dextera_build.policy.observation import Frame, Frames
from dextera_build.sim.render import rendering

Picture = Literal["rgb", "depth", "cloud"]
"""What a camera can give."""


class Eyes:
    """Several cameras in one model; they hold GL contexts until they are closed.

    Args:
        model: Compiled model.
        views: Name -> camera.
        pictures: What each of them gives; a cloud comes with the depth that it is made of.
    """

    def __init__(self, model: Any, views: Mapping[str, View], pictures: Collection[Picture]) -> None:
        self._pictures = frozenset(pictures)
        self._eyes = {name: rendering.through(model, view) for name, view in views.items()}
        rays = {
            name: cameras.rays(view.camera.height, view.camera.width, view.camera.matrix())
            for name, view in views.items()
        }
        self._rays = {name: each.astype(np.float32) for name, each in rays.items()}

    def look(self, data: Any) -> Frames:
        """Frames of the state in `data` (after `mj_forward`)."""
        return {name: self._frame(eye, self._rays[name], data) for name, eye in self._eyes.items()}

    def close(self) -> None:
        """Free the GL contexts."""
        for eye in self._eyes.values():
            eye.__exit__(None, None, None)
        self._eyes = {}

    def _frame(self, eye: rendering.Eye, rays: np.ndarray, data: Any) -> Frame:
        rgb = eye.rgb(data) if "rgb" in self._pictures else None
        depth = eye.depth(data) if self._pictures & {"depth", "cloud"} else None
        cloud = depth[..., None] * rays if depth is not None and "cloud" in self._pictures else None
        return Frame(rgb, depth, cloud)

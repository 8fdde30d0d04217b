"""The photographed scene as a robot's camera shows it, from which a tracker learns what its objects look like."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera, Capture
from dextera_build.artifacts.robots.cell import Cell
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.errors import RuleError
from dextera_build.sim.runtime import starts
from dextera_build.sim.runtime.cell_camera import CellCamera
from dextera_build.sim.runtime.environment import Environment

Scene = tuple[np.ndarray, np.ndarray]
"""Colours (H, W, 3) uint8 and depth (H, W) [m]; 0 where nothing was measured."""


def pictured(capture: Capture, camera: Camera) -> Scene:
    """The photograph with its depth as a camera of other intrinsics at the same place has it.

    Raises:
        RuleError: Depth was not measured.
    """
    import cv2

    if capture.measured is None:
        raise RuleError(
            "the photograph has no depth, from which the tracker would learn its objects",
            code="DXB-B558",
            hint="leave `--photograph` out; the tracker then learns them from a drawing of the twin",
        )
    own = capture.photograph.camera.matrix()
    way, size = camera.matrix() @ np.linalg.inv(own), (camera.width, camera.height)
    shrunk = min(1.0, camera.fx / own[0, 0])
    rgb = capture.photograph.rgb.pixels
    # Pixels of a smaller picture are means; without that, fine print would turn into noise.
    soft = cv2.GaussianBlur(rgb, (0, 0), 0.5 / shrunk) if shrunk < 0.8 else rgb
    colours = cv2.warpPerspective(soft, way, size, flags=cv2.INTER_LINEAR)
    depth = cv2.warpPerspective(capture.measured.depth.depth, way, size, flags=cv2.INTER_NEAREST)
    return np.asarray(colours), np.asarray(depth)


def drawn(bundle: TaskBundle, cell: Cell, camera: Camera) -> Scene:
    """The twin of the photographed scene, drawn from where the calibration has the camera."""
    environment = Environment(bundle)
    environment.begin(starts.photographed(bundle, environment.model))
    seen = cell.model_copy(update={"camera": camera, "eye": cell.mount.inverse()})
    with CellCamera(environment, seen) as eye:
        rgb, depth = eye.picture()
    return np.asarray(np.round(rgb * 255), np.uint8), depth

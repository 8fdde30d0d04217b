"""Cells: the camera and the tracker through which policies see a world that stands in for hardware."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np

from dextera_build.artifacts import former
from dextera_build.artifacts.base import Artifact, Value
from dextera_build.artifacts.camera import Camera
from dextera_build.artifacts.frames import Frames
from dextera_build.artifacts.noise import ColourNoise, DepthNoise
from dextera_build.artifacts.object import Asset
from dextera_build.artifacts.pose import Pose
from dextera_build.geometry import transforms

Corner = tuple[float, float, float]


class Limits(Value):
    """What a robot in a cell must not do; its guard stops it."""

    speed: float = 1.0
    """Part of every joint's speed limit that targets may use, 0..1."""
    workspace_m: tuple[Corner, Corner] | None = None
    """Lowest and highest x, y, z of every palm in the base frame [m]; None: everywhere."""
    force_n: float | None = None
    """Largest force on a fingertip [N]; None: any, as for hands that do not feel."""
    silence_s: float = 1.0
    """Time without a frame of the camera after which the robot is stopped [s]."""


class Cell(Artifact):
    """What measures objects in a simulated world as hardware would: one RGB-D camera, and a tracker of the assets.

    Operators of the cell know every field except `eye`, which only the renderer of the camera may read. Only
    `evaluate.*` therefore takes a cell.
    """

    type_version: ClassVar[int] = 2
    readers: ClassVar[former.Readers] = {1: former.unchanged}

    assets: dict[str, Asset]
    """Root body of the task -> the twin's asset, placed as in the photograph; the tracker knows nothing else."""
    camera: Camera
    """Intrinsics at the size of the frames."""
    mount: Annotated[Pose, Frames("camera", "base")]
    """T_camera_base by calibration: it places what the camera sees in the robot's base."""
    eye: Annotated[Pose, Frames("base", "camera")]
    """T_base_camera as it truly is in that world, OpenCV axes."""
    rate_hz: float
    """Frames per second [Hz]."""
    delay_s: float
    """Time from a frame to the poses that were found in it [s]."""
    loss: float
    """Fraction of the frames that are lost on their way, 0..1."""
    search_s: float
    """Time before a trial, with the robot at rest, in which the task's object must be found [s]."""
    depth_noise: DepthNoise
    """Errors of the depth."""
    colour_noise: ColourNoise
    """Errors of the colours."""
    seed: int = 0
    """Seed of all noise; every trial has its own."""
    limits: Limits = Limits()
    """What its guard does not let happen."""

    def placed(self, seen: np.ndarray) -> np.ndarray:
        """T_base_object (4, 4) of T_camera_object (4, 4), through the calibration [m]."""
        return np.asarray(transforms.invert(self.mount.matrix) @ seen)

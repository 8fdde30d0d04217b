"""Cells: camera and tracker through which policies observe a simulated stand-in for hardware."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from dextera_build.artifacts.base import Artifact, Value
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.core.frames import Frames
from dextera_build.artifacts.objects.object import Asset
from dextera_build.artifacts.robots.noise import ColourNoise, DepthNoise
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import transforms

Corner = tuple[float, float, float]


class Limits(Value):
    """Limits of a robot in a cell, enforced by its guard."""

    speed: float = 1.0
    """Fraction of every joint's speed limit that targets may use, 0..1."""
    workspace_m: tuple[Corner, Corner] | None = None
    """Lowest and highest x, y, z of every palm in the base frame [m]; None: unlimited."""
    force_n: float | None = None
    """Maximum force on a fingertip [N]; None: unlimited, for hands without force sensors."""
    silence_s: float = 1.0
    """Time without a camera frame after which the robot is stopped [s]."""

    def stricter(self, other: Limits) -> Limits:
        """The limits that keep both."""
        forces = [each.force_n for each in (self, other) if each.force_n is not None]
        spaces = [np.array(each.workspace_m) for each in (self, other) if each.workspace_m is not None]
        low, high = ([space[row] for space in spaces] for row in (0, 1))
        return Limits(
            speed=min(self.speed, other.speed),
            workspace_m=(_corner(np.max(low, axis=0)), _corner(np.min(high, axis=0))) if spaces else None,
            force_n=min(forces) if forces else None,
            silence_s=min(self.silence_s, other.silence_s),
        )


def _corner(place: np.ndarray) -> Corner:
    x, y, z = (float(each) for each in place)
    return x, y, z


class Cell(Artifact):
    """A simulated measurement setup like that of hardware: one RGB-D camera, and a tracker of the assets.

    Every field except `eye` is available to the cell; only the renderer of the camera may read `eye`. Therefore only
    `evaluate.*` and `reference.episodes`, which records what a cell measures, use one, and the tracker of a real
    robot's camera.
    """

    assets: dict[str, Asset]
    """Root body of the task -> the twin's asset, placed as in the photograph; the tracker has no other information."""
    camera: Camera
    """Intrinsics at the size of the frames."""
    mount: Annotated[Pose, Frames("camera", "base")]
    """Calibrated T_camera_base, which relates camera measurements to the robot's base."""
    eye: Annotated[Pose, Frames("base", "camera")]
    """True T_base_camera in that world, OpenCV axes."""
    rate_hz: float
    """Frames per second [Hz]."""
    delay_s: float
    """Delay from a frame to its poses [s]."""
    loss: float
    """Fraction of lost frames, 0..1."""
    search_s: float
    """Time limit before a trial, with the robot at rest, to find the task's object [s]."""
    depth_noise: DepthNoise
    """Errors of the depth."""
    colour_noise: ColourNoise
    """Errors of the colours."""
    seed: int = 0
    """Seed of all noise; every trial has its own."""
    limits: Limits = Limits()
    """Limits that its guard enforces."""

    def placed(self, seen: np.ndarray) -> np.ndarray:
        """T_base_object (4, 4) from T_camera_object (4, 4), by the calibration [m]."""
        return np.asarray(transforms.invert(self.mount.matrix) @ seen)

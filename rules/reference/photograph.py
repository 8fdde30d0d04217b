"""reference.photograph: photograph a reference world as an RGB-D camera would."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from pydantic import NonNegativeInt, PositiveInt

from dextera_build.artifacts.cameras.camera import Capture, Measured, Photograph
from dextera_build.artifacts.cameras.image import DepthImage, Image
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.scenes.draw import Sensor
from dextera_build.artifacts.scenes.world import World
from dextera_build.rule import Context, Options, rule
from dextera_build.sim.render.sensor import measure_colour, measure_depth
from dextera_build.sim.render.shot import Shot

from .sensor import ColourNoiseOptions, DepthNoiseOptions


class PhotographOptions(Options):
    """Options of reference.photograph."""

    seed: NonNegativeInt = 0
    """Seed of the noise."""
    supersample: PositiveInt = 2
    """Samples per pixel edge of the colour render."""
    depth_noise: DepthNoiseOptions = DepthNoiseOptions()
    """Noise of the depth stream."""
    colour_noise: ColourNoiseOptions = ColourNoiseOptions()
    """Noise of the colour stream."""


class CameraBackend(Protocol):
    """Interface of a backend of reference.photograph."""

    def photograph(self, ctx: Context, world: World, robot: RobotModel | None, supersample: int, options: Any) -> Shot:
        """Colours, depth [m] and object labels of the world's camera, without noise."""
        ...


@rule(version=1, packages=("numpy",), cpus=2, memory_gb=2.0)
def photograph(
    ctx: Context[CameraBackend],
    world: World,
    robot: RobotModel | None = None,
    sensor: Sensor | None = None,
    *,
    options: PhotographOptions | None = None,
) -> Capture:
    """Return the output of the world's camera: colours, depth [m] with noise and holes, intrinsics.

    `sensor` gives the seed, scales the depth noise and adds lost patches.

    The backend offers `photograph(world, robot, supersample=...) -> Shot`.
    """
    options = options or PhotographOptions()
    shot = ctx.backend.photograph(ctx, world, robot, options.supersample, ctx.backend_options)
    rng = np.random.default_rng(options.seed if sensor is None else sensor.seed)
    noise = options.depth_noise if sensor is None else _scaled(options.depth_noise, sensor)
    depth = measure_depth(shot.depth, shot.rgb, world.camera.matrix(), noise, rng)
    rgb = measure_colour(shot.rgb, options.colour_noise, rng)
    valid = depth > 0
    ctx.check(bool(valid.mean() > 0.25), "most of the picture has no depth", hint="look at `world.camera`")
    error = float(np.abs(depth - shot.depth)[valid].mean())
    ctx.say(f"{rgb.shape[1]} x {rgb.shape[0]} px, depth on {valid.mean():.0%}, mean depth noise {1000 * error:.1f} mm")
    ctx.preview(rgb, "photograph")
    return Capture(
        photograph=Photograph(rgb=Image(pixels=rgb), camera=world.camera),
        measured=Measured(depth=DepthImage(depth=depth)),
    )


def _scaled(noise: DepthNoiseOptions, sensor: Sensor) -> DepthNoiseOptions:
    """The noise of a sensor, scaled by a factor."""
    patches = min(1.0, noise.patches + sensor.dropout)
    return noise.model_copy(update={"subpixel_px": noise.subpixel_px * sensor.noise, "patches": patches})

"""simulate.cell: camera and tracker through which policies observe a simulated stand-in for hardware."""

from __future__ import annotations

import numpy as np
from pydantic import Field, NonNegativeFloat, NonNegativeInt, PositiveFloat, PositiveInt

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.objects.object import Asset
from dextera_build.artifacts.robots.cell import Cell, Limits
from dextera_build.artifacts.robots.noise import ColourNoise, DepthNoise
from dextera_build.artifacts.scenes.scene import Scene
from dextera_build.artifacts.scenes.world import World
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import lie, transforms
from dextera_build.rule import Context, Fraction, Options, rule
from dextera_build.sim.model import names

from .view import scaled


class DepthNoiseOptions(DepthNoise, Options):
    """Noise of the depth stream, as of `reference.photograph`."""


class ColourNoiseOptions(ColourNoise, Options):
    """Noise of the colour stream, as of `reference.photograph`."""


class LimitsOptions(Limits, Options):
    """Limits that the cell's guard enforces."""

    speed: float = Field(1.0, gt=0.0, le=1.0)
    """Fraction of every joint's speed limit that targets may use."""
    force_n: PositiveFloat | None = None
    """Maximum force on a fingertip [N]; None: unlimited, for hands without force sensors."""
    silence_s: PositiveFloat = 1.0
    """Time without a camera frame after which the robot is stopped [s]."""


class CellOptions(Options):
    """Options of simulate.cell."""

    width_px: PositiveInt = 640
    """Width of a frame [px]."""
    height_px: PositiveInt = 480
    """Height of a frame [px]."""
    rate_hz: PositiveFloat = 15.0
    """Frames per second [Hz]."""
    delay_s: NonNegativeFloat = 0.06
    """Delay from the exposure of a frame to its poses [s]."""
    loss: Fraction = 0.02
    """Fraction of lost frames."""
    search_s: PositiveFloat = 3.0
    """Time limit before a trial, with the robot at rest, to find the task's object [s]."""
    depth_noise: DepthNoiseOptions = DepthNoiseOptions(smear=0.3, dark_loss=0.2, shine_loss=0.5)
    """Noise of the depth stream."""
    colour_noise: ColourNoiseOptions = ColourNoiseOptions()
    """Noise of the colour stream."""
    limits: LimitsOptions = LimitsOptions()
    """Limits that the cell's guard enforces: speeds, palm positions, forces on fingertips, silence."""
    error_m: NonNegativeFloat = 0.002
    """Without a `world`: standard deviation of the calibrated camera's position from the true one, per axis, if its
    covariance is unknown [m]."""
    error_deg: NonNegativeFloat = 0.2
    """The same for its orientation [deg]."""
    seed: NonNegativeInt = 0
    """Seed of that error and of all noise."""


@rule(version=2, packages=("numpy",))
def cell(
    ctx: Context,
    scene: Scene,
    assets: Collection[Asset],
    base: Pose,
    measured: Pose | None = None,
    world: World | None = None,
    *,
    options: CellOptions,
) -> Cell:
    """Return the tracker's inputs, T_camera_base by calibration [m], and the true pose of the camera.

    `measured` is T_camera_base of `align.camera_base`; without it, it follows from the photograph's camera and `base`,
    T_world_base. The `world` contains the true pose of its camera, so that the calibration has its actual error;
    without a world an error is drawn. The true pose is used by the renderer only, and cells only by `evaluate.*`.
    """
    mount = scene.camera_pose.inverse() @ base if measured is None else measured
    ctx.check(
        (mount.parent, mount.child) == ("camera", "base"),
        f"the calibration is T_{mount.parent}_{mount.child}, but T_camera_base is needed",
        hint="take it from `align.camera_base`",
    )
    eye = _disturbed(mount, options) if world is None else _true(ctx, world, scene)
    off = transforms.invert(mount.inverse().matrix) @ eye.matrix
    distance, angle = 1000 * float(np.linalg.norm(off[:3, 3])), float(np.degrees(transforms.angle(off[:3, :3])))
    ctx.metric("error of the calibration, position", distance, "mm")
    ctx.metric("error of the calibration, rotation", angle, "deg")
    known = {body: assets.items[label] for label, body in names.body_names(assets.items).items()}
    ctx.say(
        f"{len(known)} assets, {options.rate_hz:g} Hz, {1000 * options.delay_s:g} ms delay; "
        f"calibration {distance:.1f} mm and {angle:.2f} deg off; simulated"
    )
    return Cell(
        assets=known,
        camera=scaled(scene.camera, options.width_px, options.height_px),
        mount=mount,
        eye=eye,
        rate_hz=options.rate_hz,
        delay_s=options.delay_s,
        loss=options.loss,
        search_s=options.search_s,
        depth_noise=DepthNoise(**options.depth_noise.model_dump()),
        colour_noise=ColourNoise(**options.colour_noise.model_dump()),
        seed=options.seed,
        limits=Limits(**options.limits.model_dump()),
    )


def _true(ctx: Context, world: World, scene: Scene) -> Pose:
    """T_base_camera of a reference world."""
    if world.stand is None:
        ctx.fail("this world has no robot", hint="give `reference.world` option `robot`")
    ctx.check(
        world.camera == scene.camera,
        "the camera of the world is not the one that photographed the twin",
        world=f"{world.camera.width} x {world.camera.height} px, fx {world.camera.fx:g}",
        twin=f"{scene.camera.width} x {scene.camera.height} px, fx {scene.camera.fx:g}",
        hint="give the world of the capture that the twin was built from",
    )
    return world.stand.pose().inverse() @ world.camera_pose


def _disturbed(mount: Pose, options: CellOptions) -> Pose:
    """T_base_camera with an error drawn from the calibration's covariance, or from the options."""
    back = mount.inverse()
    spread = back.covariance
    if spread is None:
        sigmas = [options.error_m] * 3 + [np.radians(options.error_deg)] * 3
        spread = np.diag(np.square(sigmas))
    random = np.random.default_rng([options.seed, 4])
    error = random.multivariate_normal(np.zeros(6), spread, method="eigh")
    return back.model_copy(update={"matrix": lie.retract(back.matrix, error), "covariance": None})

"""simulate.task: combine a scene, an embodiment and a primitive into a runnable task."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt

from dextera_build.artifacts.base import Collection, Folder
from dextera_build.artifacts.object import Asset
from dextera_build.artifacts.pose import Pose
from dextera_build.artifacts.robot import RobotModel
from dextera_build.artifacts.scene import Scene
from dextera_build.artifacts.task import Primitive, Reset, TaskBundle, TaskObject, TaskSpec
from dextera_build.errors import listing
from dextera_build.geometry import kinematics, metrics
from dextera_build.rule import Context, Options, rule
from dextera_build.sim.model import names


class ResetOptions(Options):
    """Start distribution: half ranges around the photograph's configuration."""

    position_m: NonNegativeFloat = 0.05
    """Half width of the square in which the task's object is placed [m]."""
    yaw_deg: NonNegativeFloat = 20.0
    """Maximum rotation of the task's object about the vertical [deg]."""
    clutter_m: NonNegativeFloat = 0.01
    """Half width of the square in which every other object is placed [m]."""
    joint_deg: NonNegativeFloat = 0.0
    """Half range of the joints of the task's object [deg]."""
    robot_deg: NonNegativeFloat = 2.0
    """Half range of every joint of the robot around home [deg]."""
    dynamics: NonNegativeFloat = 1.0
    """Fraction of the twin's own intervals to draw masses, sizes, friction, gains and known errors of poses from."""


class TaskOptions(Options):
    """Options of simulate.task: the objective."""

    name: str
    """Name of the task: `CloseLaptop`."""
    primitive: Primitive
    """Kind of objective."""
    object: str
    """Label of the task's asset."""
    height_m: PositiveFloat = 0.10
    """lift: required rise [m]."""
    joints_deg: dict[str, float] = Field(default_factory=dict)
    """articulate: joint of the asset -> commanded position [deg]."""
    tolerance_deg: PositiveFloat = 5.0
    """articulate: maximum distance from the command [deg]."""
    hold_s: NonNegativeFloat = 0.5
    """Time for which the condition must hold [s]."""
    timeout_s: PositiveFloat = 8.0
    """Time limit of an episode [s]."""
    control_hz: PositiveFloat = 20.0
    """Rate of observations and actions [Hz]."""
    reset: ResetOptions = ResetOptions()
    """Start distribution."""
    points: PositiveInt = 256
    """Number of points sampled on every object's surface."""


class TaskBackend(Protocol):
    """What a backend of simulate.task defines."""

    def fitted(self, ctx: Context, joints: Mapping[str, list[str]], common: TaskOptions, options: Any) -> TaskOptions:
        """The options of the recipe, fitted to the bodies and their joints."""
        ...

    def compose(
        self, ctx: Context, scene: Folder, robot: RobotModel, world_from_base: np.ndarray, options: Any
    ) -> Folder:
        """Scene and robot as one MJCF."""
        ...

    def portraits(self, ctx: Context, bundle: TaskBundle, options: Any) -> list[tuple[str, np.ndarray]]:
        """Captions and pictures (H, W, 3) uint8."""
        ...


@rule(version=1, packages=("numpy",))
def task(
    ctx: Context[TaskBackend],
    scene: Scene,
    assets: Collection[Asset],
    robot: RobotModel,
    base: Pose,
    *,
    options: TaskOptions,
) -> TaskBundle:
    """Return the task in the twin: scene and robot as one MJCF in the world frame [m, kg, rad], and its success test.

    The backend offers `fitted(options, joints) -> options`, `compose(scene, robot, world_from_base) -> Folder` and
    `portraits(bundle) -> list of (caption, pixels)`. Masses, sizes, friction and poses carry the twin's own uncertainty
    (90 % interval, standard deviations, covariance), from which resets draw.
    """
    if scene.scale == "unknown":
        ctx.fail(
            "the scale of this twin is unknown, so no task can be built on it",
            hint="state one size (`object` and `size_m` of `align.scale`), lay a marker on the support (`marker` of "
            "`align.support`), or measure depth",
        )
    labels = {label: body for label, body in names.body_names(assets.items).items() if body not in scene.held}
    bodies = {body: assets.items[label] for label, body in labels.items()}
    if options.object in scene.held:
        ctx.fail(
            f"`{options.object}` cannot be moved: it would not rest, so it is a part of the static scene",
            free=listing(bodies, most=20),
            hint="see the warnings of `simulate.steady`, and correct its mask or shape",
        )
    options = ctx.backend.fitted(
        ctx, {name: _joint_labels(assets, label) for label, name in labels.items()}, options, ctx.backend_options
    )
    ctx.check(
        options.object in bodies,
        f"the scene has no object `{options.object}`",
        objects=listing(bodies, most=20),
        hint=f"set `object: {next(iter(bodies), '')}`",
    )
    ctx.check(base.parent == "world", f"the robot's base is given in `{base.parent}`, not in the world")
    spec = _spec(ctx, options, assets, labels)
    bundle = TaskBundle(
        model=ctx.backend.compose(ctx, scene.model, robot, base.matrix, ctx.backend_options),
        robot=robot,
        base_pose=base,
        task=spec,
        objects={body: _object(assets, label, options.points) for label, body in labels.items()},
    )
    reach = float(np.linalg.norm(bodies[options.object].pose.matrix[:2, 3] - base.matrix[:2, 3]))
    ctx.metric("distance of base and object", reach, "m")
    ctx.say(
        f"{options.name}: {options.primitive} `{options.object}`, {len(robot.joints)} joints, base {reach:.2f} m away"
    )
    for caption, picture in ctx.backend.portraits(ctx, bundle, ctx.backend_options):
        ctx.preview(picture, caption)
    return bundle


def _spec(ctx: Context, options: TaskOptions, assets: Collection[Asset], labels: dict[str, str]) -> TaskSpec:
    label = next(label for label, body in labels.items() if body == options.object)
    goals: dict[str, float] = {}
    if options.primitive == "articulate":
        known = dict(zip(_joint_labels(assets, label), _joint_names(assets, label), strict=True))
        ctx.check(bool(options.joints_deg), f"`{options.name}` names no joint to move", joints=listing(known, most=20))
        for joint, goal in options.joints_deg.items():
            ctx.check(
                joint in known, f"`{options.object}` has no joint `{joint}`", joints=listing(known, most=20) or "none"
            )
            goals[known[joint]] = float(np.radians(goal))
            _check_reachable(
                ctx, assets.items[label], joint, goals[known[joint]], float(np.radians(options.tolerance_deg))
            )
    reset = options.reset
    return TaskSpec(
        name=options.name,
        primitive=options.primitive,
        object=options.object,
        height_m=options.height_m if options.primitive == "lift" else 0.0,
        joints=goals,
        tolerance=float(np.radians(options.tolerance_deg)) if goals else 0.0,
        hold_s=options.hold_s,
        timeout_s=options.timeout_s,
        control_hz=options.control_hz,
        reset=Reset(
            position_m=reset.position_m,
            yaw_rad=float(np.radians(reset.yaw_deg)),
            clutter_m=reset.clutter_m,
            joint_rad=float(np.radians(reset.joint_deg)),
            robot_rad=float(np.radians(reset.robot_deg)),
            dynamics=reset.dynamics,
        ),
    )


def _check_reachable(ctx: Context, asset: Asset, name: str, goal: float, tolerance: float) -> None:
    joint = next(joint for joint in asset.body.joints if joint.name == name)
    ctx.check(
        joint.lower - tolerance <= goal <= joint.upper + tolerance,
        f"joint `{name}` cannot reach {np.degrees(goal):.1f}°",
        limits=f"{np.degrees(joint.lower):.1f}° to {np.degrees(joint.upper):.1f}°",
        hint="set `joints_deg` inside the limits",
    )


def _joint_labels(assets: Collection[Asset], label: str) -> list[str]:
    return [joint.name for joint in assets.items[label].body.joints]


def _joint_names(assets: Collection[Asset], label: str) -> list[str]:
    """Names in the MJCF: body of the child link and joint."""
    links = names.link_names(assets.items)
    return [f"{links[label, joint.child]}_{names.plain(joint.name)}" for joint in assets.items[label].body.joints]


def _object(assets: Collection[Asset], label: str, count: int) -> TaskObject:
    asset = assets.items[label]
    low, high = 1.0, 1.0
    total = sum(link.mass_kg for link in asset.physics.links.values())
    if total > 0:
        low = sum(link.mass_low_kg for link in asset.physics.links.values()) / total
        high = sum(link.mass_high_kg for link in asset.physics.links.values()) / total
    return TaskObject(
        joints=tuple(_joint_names(assets, label)),
        pose=asset.pose,
        positions=tuple(joint.position for joint in asset.body.joints),
        mass_scale=(low, high),
        scale_sigma=asset.scale_sigma,
        friction=asset.physics.friction,
        friction_sigma=asset.physics.friction_sigma,
        points=metrics.sample_surface(*kinematics.posed_surface(asset.body), count, seed=0).astype(np.float32),
    )

"""simulate.task: combine a scene, an embodiment and a primitive into a runnable task."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from pydantic import NonNegativeFloat, PositiveFloat, PositiveInt, model_validator

from dextera_build.artifacts.base import Collection, Folder
from dextera_build.artifacts.objects.object import Asset
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.scenes.scene import Scene
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.artifacts.tasks.task import ActionKind, Reset, TaskBundle, TaskObject, TaskSpec
from dextera_build.errors import listing
from dextera_build.policy import actions
from dextera_build.rule import Context, Options, rule
from dextera_build.sim.model import names
from dextera_build.sim.primitives import base as primitives
from dextera_build.sim.primitives.base import Setting, UnfitError, no_limb

from . import task_objects


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
    """Fraction of the twin's own intervals from which masses, sizes, friction, gains and known pose errors of the
    objects and of the robot's base are drawn."""
    joints: NonNegativeFloat = 0.0
    """Fraction of the full range from which factors on damping and friction of joints are drawn; 1: factors of 0.6
    to 1.65."""
    goal_m: NonNegativeFloat = 0.0
    """Half width of the square in which a target is placed, or half range of a lift height [m]."""
    goal_deg: NonNegativeFloat = 0.0
    """Half range of a target's rotation about the vertical, or of commanded joint positions [deg]."""
    visual: NonNegativeFloat = 0.0
    """Fraction of the cameras' calibration covariance, and of the ranges of exposure, light and noise, from which
    they are drawn. The photograph's camera has no error of its own if the base has one."""


class TaskOptions(Options):
    """Options of simulate.task: the objective; the options of its goal are a group with the primitive's name."""

    name: str
    """Name of the task: `CloseLaptop`."""
    primitive: str
    """Kind of objective: a folder in `primitives/`, whose options are set as `lift: {height_m: 0.1}`."""
    object: str
    """Label of the task's asset."""
    limbs: tuple[str, ...] = ()
    """Limbs that must act, jointly if several are named; empty: any."""
    hold_s: NonNegativeFloat = 0.5
    """Time for which the condition must hold [s]."""
    timeout_s: PositiveFloat = 8.0
    """Time limit of an episode [s]."""
    control_hz: PositiveFloat = 20.0
    """Rate of observations and actions [Hz]."""
    action: ActionKind = "joint"
    """Kind of actions of the Gymnasium environment and of LeRobot data sets: joint targets, their changes, or
    changes of palm poses with finger targets."""
    reset: ResetOptions = ResetOptions()
    """Start distribution."""
    points: PositiveInt = 256
    """Number of points sampled on every object's surface."""

    @model_validator(mode="after")
    def _possible(self) -> TaskOptions:
        if len(set(self.limbs)) < len(self.limbs):
            raise ValueError("`limbs` names one limb twice; name each once")
        if self.hold_s >= self.timeout_s:
            raise ValueError("`hold_s` leaves no time before `timeout_s`; set `timeout_s` above it")
        return self


class TaskBackend(Protocol):
    """Interface of a backend of simulate.task."""

    def fitted(
        self,
        ctx: Context,
        joints: Mapping[str, list[str]],
        common: TaskOptions,
        own: primitives.Options,
        options: Any,
    ) -> tuple[TaskOptions, primitives.Options]:
        """The options of the recipe and of its primitive, fitted to the bodies and their joints."""
        ...

    def compose(
        self, ctx: Context, scene: Folder, robot: RobotModel, world_from_base: np.ndarray, options: Any
    ) -> Folder:
        """Scene and robot as one MJCF."""
        ...

    def portraits(self, ctx: Context, bundle: TaskBundle, options: Any) -> list[tuple[str, np.ndarray]]:
        """Captions and pictures (H, W, 3) uint8; raises for a task that cannot be started or is out of reach."""
        ...


class PrimitiveFile(Protocol):
    """Interface of `primitive.py`."""

    Options: type[primitives.Options]
    """The options of its goal."""
    Primitive: type[primitives.Primitive[Any]]
    """The condition of success, and the value of a state."""


@rule(version=3, packages=("numpy",), folders={"primitive": "primitives"})
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

    The backend offers `fitted(joints, options, own) -> options, own`, `compose(scene, robot, world_from_base) ->
    Folder` and `portraits(bundle) -> list of (caption, pixels)`. Masses, sizes, friction and poses carry the twin's own
    uncertainty (90 % interval, standard deviations, covariance), from which resets draw.
    """
    _check_scale(ctx, scene)
    labels = {label: body for label, body in names.body_names(assets.items).items() if body not in scene.held}
    bodies = {body: assets.items[label] for label, body in labels.items()}
    if options.object in scene.held:
        ctx.fail(
            f"`{options.object}` cannot be moved: it is held as a part of the static scene",
            why=scene.held[options.object],
            free=listing(bodies, most=20),
            hint="see the warnings of `simulate.steady`, and correct its mask or shape",
        )
    file, own = ctx.named("primitive", PrimitiveFile)
    in_assets = {name: _joint_labels(assets, label) for label, name in labels.items()}
    options, own = ctx.backend.fitted(ctx, in_assets, options, own, ctx.backend_options)
    ctx.check(
        options.object in bodies,
        f"the scene has no object `{options.object}`",
        objects=listing(bodies, most=20),
        hint=f"set `object: {next(iter(bodies), '')}`",
    )
    task_objects.check(ctx, scene, labels, assets)
    ctx.check(base.parent == "world", f"the robot's base is given in `{base.parent}`, not in the world")
    objects = {body: task_objects.described(assets, label, options.points) for label, body in labels.items()}
    for name in objects.keys() & set(own.containers):
        objects[name] = task_objects.hollowed(objects[name], bodies[name])
    _check_hands(ctx, file.Primitive, options, robot)
    setting = Setting(options.name, options.object, objects, _joints(bodies, objects, options), robot)
    bundle = TaskBundle(
        model=ctx.backend.compose(ctx, scene.model, robot, base.matrix, ctx.backend_options),
        robot=robot,
        base_pose=base,
        task=_spec(ctx, options, own, file.Primitive, setting),
        objects=objects,
    )
    reach = float(np.linalg.norm(bodies[options.object].pose.matrix[:2, 3] - base.matrix[:2, 3]))
    ctx.metric("distance of base and object", reach, "m")
    ctx.say(
        f"{options.name}: {options.primitive} `{options.object}`, {len(robot.joints)} joints, base {reach:.2f} m away"
    )
    for caption, picture in ctx.backend.portraits(ctx, bundle, ctx.backend_options):
        ctx.preview(picture, caption)
    return bundle


def _check_scale(ctx: Context, scene: Scene) -> None:
    if scene.scale == "unknown":
        ctx.fail(
            "the scale of this twin is unknown, so no task can be built on it",
            hint="state one size (`object` and `size_m` of `align.scale`), lay a marker on the support (`marker` of "
            "`align.support`), or measure depth",
        )


def _check_hands(ctx: Context, kind: type[primitives.Primitive[Any]], options: TaskOptions, robot: RobotModel) -> None:
    if kind.hands > len(robot.limbs):
        ctx.fail(
            f"`{options.primitive}` takes {kind.hands} hands, but the robot has {len(robot.limbs)}",
            limbs=listing(robot.limb_names),
            hint="choose a robot with more limbs, such as robot/openarm_revo1",
        )


def _joints(
    bodies: Mapping[str, Asset], objects: Mapping[str, TaskObject], options: TaskOptions
) -> dict[str, tuple[str, float, float]]:
    """Joint of the task's object in its asset -> name in the model, lower and upper limit."""
    joints = bodies[options.object].body.joints
    names = objects[options.object].joints
    return {joint.name: (name, joint.lower, joint.upper) for joint, name in zip(joints, names, strict=True)}


def _spec(
    ctx: Context,
    options: TaskOptions,
    own: primitives.Options,
    kind: type[primitives.Primitive[Any]],
    setting: Setting,
) -> TaskSpec:
    try:
        for limb in options.limbs:
            if limb not in setting.robot.limbs:
                raise no_limb(limb, setting.robot)
        goal = own.goal(setting)
    except UnfitError as error:
        ctx.fail(error.message, hint=error.hint, **error.facts)
    ctx.check(goal.primitive == options.primitive, f"the goal of `{options.primitive}` is one of `{goal.primitive}`")
    reset = options.reset
    spec = TaskSpec(
        name=options.name,
        object=options.object,
        goal=goal,
        limbs=options.limbs,
        hold_s=options.hold_s,
        timeout_s=options.timeout_s,
        control_hz=options.control_hz,
        action=options.action,
        reset=Reset(
            position_m=reset.position_m,
            yaw_rad=float(np.radians(reset.yaw_deg)),
            clutter_m=reset.clutter_m,
            joint_rad=float(np.radians(reset.joint_deg)),
            robot_rad=float(np.radians(reset.robot_deg)),
            dynamics=reset.dynamics,
            joints=reset.joints,
            goal_m=reset.goal_m,
            goal_rad=float(np.radians(reset.goal_deg)),
            visual=reset.visual,
        ),
    )
    ctx.check(
        not (options.limbs and kind(spec, setting.objects).ordered()),
        f"`limbs` gives the hands of `{options.primitive}` no roles",
        hint=f"leave it out, and name them in `{options.primitive}: {{...}}`",
    )
    actions.of_task(spec, setting.robot)  # raises for a kind that the robot lacks
    return spec


def _joint_labels(assets: Collection[Asset], label: str) -> list[str]:
    return [joint.name for joint in assets.items[label].body.joints]

"""simulate.task: combine a scene, an embodiment and a primitive into a runnable task."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from pydantic import NonNegativeFloat, NonNegativeInt, PositiveFloat, PositiveInt, ValidationError, model_validator

from dextera_build.artifacts.base import Collection, Folder
from dextera_build.artifacts.object import Asset
from dextera_build.artifacts.pose import Pose
from dextera_build.artifacts.robot import RobotModel
from dextera_build.artifacts.scene import Scene
from dextera_build.artifacts.task import ActionKind, Primitive, Reset, TaskBundle, TaskObject, TaskSpec
from dextera_build.errors import listing
from dextera_build.policy import actions
from dextera_build.rule import Context, Options, rule
from dextera_build.sim.model import names
from dextera_build.sim.primitives import catalogue
from dextera_build.sim.primitives.base import Parameters, Setting, UnfitError, no_limb

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
    """Options of simulate.task: the objective, and the goal options of its primitive."""

    name: str
    """Name of the task: `CloseLaptop`."""
    primitive: Primitive
    """Kind of objective."""
    object: str
    """Label of the task's asset."""
    limbs: tuple[str, ...] = ()
    """Limbs that must act, jointly if several are named; empty: any."""
    height_m: PositiveFloat | None = None
    """lift: required rise [m]; default 0.10."""
    joints_deg: dict[str, float] | None = None
    """articulate: joint of the asset -> commanded position [deg]."""
    to_m: tuple[float, float] | tuple[float, float, float] | None = None
    """Other primitives: target position of the object's origin in the world, x and y for a push, else x, y and z
    [m]."""
    by_m: tuple[float, float] | tuple[float, float, float] | None = None
    """The same, as a displacement from the photographed position [m]."""
    yaw_deg: float | None = None
    """push: target rotation about the vertical from the photographed orientation [deg]; None: any."""
    turn_deg: tuple[float, float, float] | None = None
    """pick_and_reorient, pick_and_place: target orientation as rotations of the photographed one about x, y, z
    [deg]."""
    into: str | None = None
    """pick_and_place: label of the container whose cavity must contain the object, instead of a target position."""
    tolerance_m: PositiveFloat | None = None
    """Maximum distance from a target [m]; default 0.03."""
    tolerance_deg: PositiveFloat | None = None
    """Maximum deviation of joints from their command, or of the rotation from a target [deg]; default 5, or 15."""
    symmetry: NonNegativeInt | None = None
    """Order of the object's rotational symmetry about its own z axis; 0: any rotation; default 1."""
    giver: str | None = None
    """handover: limb that picks up the object."""
    receiver: str | None = None
    """handover: limb that holds it at the end."""
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
        parameters_of(self)
        if len(set(self.limbs)) < len(self.limbs):
            raise ValueError("`limbs` names one limb twice; name each once")
        if self.limbs and self.primitive == "handover":
            raise ValueError("`limbs` does not say who gives; name the hands of a handover by `giver` and `receiver`")
        if self.hold_s >= self.timeout_s:
            raise ValueError("`hold_s` leaves no time before `timeout_s`; set `timeout_s` above it")
        return self


class TaskBackend(Protocol):
    """Interface of a backend of simulate.task."""

    def fitted(self, ctx: Context, joints: Mapping[str, list[str]], common: TaskOptions, options: Any) -> TaskOptions:
        """The options of the recipe, fitted to the bodies and their joints."""
        ...

    def compose(
        self, ctx: Context, scene: Folder, robot: RobotModel, world_from_base: np.ndarray, options: Any
    ) -> Folder:
        """Scene and robot as one MJCF."""
        ...

    def portraits(self, ctx: Context, bundle: TaskBundle, options: Any) -> list[tuple[str, np.ndarray]]:
        """Captions and pictures (H, W, 3) uint8; raises for a task that cannot be started or is out of reach."""
        ...


@rule(version=2, packages=("numpy",))
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
    _check_scale(ctx, scene)
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
    task_objects.check(ctx, scene, labels, assets)
    ctx.check(base.parent == "world", f"the robot's base is given in `{base.parent}`, not in the world")
    objects = {body: task_objects.described(assets, label, options.points) for label, body in labels.items()}
    if options.into in objects:
        objects[options.into] = task_objects.hollowed(objects[options.into], bodies[options.into])
    bundle = TaskBundle(
        model=ctx.backend.compose(ctx, scene.model, robot, base.matrix, ctx.backend_options),
        robot=robot,
        base_pose=base,
        task=_spec(ctx, options, bodies[options.object], objects, robot),
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


def parameters_of(options: TaskOptions) -> Parameters:
    """The parameters of the primitive from the options.

    Raises:
        ValueError: An option belongs to another primitive, or has a value that this one does not accept.
    """
    kind = catalogue.KINDS[options.primitive]
    every = {name for each in catalogue.KINDS.values() for name in each.parameters.model_fields}
    stated = {name: value for name in every if (value := getattr(options, name)) is not None}
    own = kind.parameters.model_fields
    if foreign := sorted(set(stated) - set(own)):
        raise ValueError(f"`{foreign[0]}` is no option of primitive `{options.primitive}`, which has {listing(own)}")
    try:
        return kind.parameters(**stated)
    except ValidationError as error:
        first = error.errors()[0]
        where = "".join(f"`{part}` of " for part in first["loc"][:1])
        text = first["msg"].removeprefix("Value error, ")
        raise ValueError(f"{where}primitive `{options.primitive}`: {text}") from None


def _spec(
    ctx: Context, options: TaskOptions, asset: Asset, objects: dict[str, TaskObject], robot: RobotModel
) -> TaskSpec:
    kind = catalogue.KINDS[options.primitive]
    if kind.hands > len(robot.limbs):
        ctx.fail(
            f"`{options.primitive}` takes {kind.hands} hands, but the robot has {len(robot.limbs)}",
            limbs=listing(robot.limb_names),
            hint="choose a robot with more limbs, such as robot/openarm_revo1",
        )
    within = {joint.name: (joint.lower, joint.upper) for joint in asset.body.joints}
    in_model = dict(zip((joint.name for joint in asset.body.joints), objects[options.object].joints, strict=True))
    joints = {label: (in_model[label], *limits) for label, limits in within.items()}
    try:
        for limb in options.limbs:
            if limb not in robot.limbs:
                raise no_limb(limb, robot)
        goal = parameters_of(options).goal(Setting(options.name, options.object, objects, joints, robot))
    except UnfitError as error:
        ctx.fail(error.message, hint=error.hint, **error.facts)
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
    actions.of_task(spec, robot)  # raises for a kind that the robot lacks
    return spec


def _joint_labels(assets: Collection[Asset], label: str) -> list[str]:
    return [joint.name for joint in assets.items[label].body.joints]

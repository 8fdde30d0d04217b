"""Starts of episodes: randomised poses, joints, dynamics and robot configurations.

Dynamics and sizes are drawn from the confidence intervals of the twin's own estimates, not from a fixed percentage.
Poses of objects and of the robot's base with a known covariance are drawn from it, in addition to the task's ranges. A
start is complete and is stored with its episode, so that any episode can be rerun.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from dextera_build.artifacts.tasks.episode import Start
from dextera_build.artifacts.tasks.task import Reset, TaskBundle, TaskObject
from dextera_build.geometry import lie, quaternions, transforms
from dextera_build.sim.model.compose import ROBOT
from dextera_build.sim.runtime import variations
from dextera_build.sim.runtime.dynamics import Dynamics
from dextera_build.sim.runtime.refused import Refused
from dextera_build.sim.runtime.seeds import seed_of
from dextera_build.sim.runtime.strata import Draws, Strata, Stratum
from dextera_build.statistics import Z90

TRIES = 200
"""Maximum number of draws before a task is reported as too crowded."""
TOUCH_M = 0.001
"""Maximum penetration at a start [m]."""
GAINS = 0.10
"""Half range of the factor on the robot's gains, times `Reset.dynamics`."""
STATIC = "the static scene"
"""Name of unnamed parts of the world body."""

Fair = Callable[[Mapping[str, np.ndarray]], np.ndarray]
"""Whether episodes may begin (N,) with the bodies at these poses, body -> T_world_body (N, 4, 4)."""


def draw(
    bundle: TaskBundle,
    model: Any,
    data: Any,
    changed: Dynamics,
    seed: int,
    fair: Fair = lambda places: np.ones(1, bool),
    *,
    stratum: Stratum | None = None,
    share: float = 1.0,
) -> Start:
    """Draw a start of the task, deterministic in bundle and seed.

    Args:
        bundle: The task.
        model: Its compiled model; its objects and its robot's base are set to those of the start.
        data: A `mujoco.MjData` of that model, used as scratch.
        changed: Changes that model.
        seed: Any integer from 0 to 2^63.
        fair: Rejects starts at which the goal is reached.
        stratum: Position in a series of episodes with stratified sampling; None: independent draws.
        share: Fraction of the task's ranges from which the start is drawn, 0..1.

    Raises:
        RuleError: No start without collisions, on the support and away from the goal was found.
    """
    bundle = bundle if share == 1.0 else _narrowed(bundle, share)
    random = _numbers([seed], stratum, 0)
    dynamics = _dynamics(bundle, random)
    # Base and variations have random streams of their own, so that other draws do not depend on them.
    base_error = variations.base(bundle, _numbers([seed_of("base", seed)], stratum, 2))
    changed.shape(dynamics["size_scale"], base_error)
    first = random.asked if isinstance(random, Strata) else 0
    refused = Refused()
    for _ in range(TRIES):
        if isinstance(random, Strata):
            random.asked = first
        mujoco.mj_resetDataKeyframe(model, data, 0)
        _place_objects(bundle, data, dynamics["size_scale"], random)
        _pose_robot(bundle, model, data, random)
        mujoco.mj_forward(model, data)
        if _free(model, data) and not _off_support(bundle, model, data) and fair(_places(bundle, data))[0]:
            break
        refused.note(_colliding(model, data), _off_support(bundle, model, data))
    else:
        raise refused.error(bundle)
    return Start(
        seed=seed,
        qpos=data.qpos.copy(),
        ctrl=data.ctrl.copy(),
        base_error=base_error,
        variation=variations.draw(bundle, _numbers([seed, 1], stratum, 1)),
        **dynamics,
    )


def photographed(bundle: TaskBundle, model: Any) -> Start:
    """The configuration of the photograph, with the robot at home and nominal estimates."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    return Start(
        seed=0,
        qpos=data.qpos.copy(),
        ctrl=data.ctrl.copy(),
        mass_scale=dict.fromkeys(bundle.objects, 1.0),
        friction={name: thing.friction for name, thing in bundle.objects.items()},
        gain_scale=1.0,
    )


def _narrowed(bundle: TaskBundle, share: float) -> TaskBundle:
    """The task with this fraction of its ranges of starts."""
    ranges = {name: share * value for name, value in bundle.task.reset}
    return bundle.model_copy(update={"task": bundle.task.model_copy(update={"reset": Reset(**ranges)})})


def _numbers(seed: list[int], stratum: Stratum | None, series: int) -> Draws:
    """Random numbers; with a stratum, those of another series, derived by the offset `series`."""
    generator = np.random.default_rng(seed)
    return generator if stratum is None else Strata(replace(stratum, series=stratum.series + series), generator)


def _dynamics(bundle: TaskBundle, random: Draws) -> dict[str, Any]:
    width = bundle.task.reset.dynamics
    mass, friction = {}, {}
    for name, thing in bundle.objects.items():
        low, high = (1.0 + width * (end - 1.0) for end in thing.mass_scale)
        mass[name] = float(random.uniform(low, high))
        spread = width * Z90 * thing.friction_sigma
        drawn = thing.friction + width * thing.friction_sigma * float(random.standard_normal())
        friction[name] = float(max(0.05, np.clip(drawn, thing.friction - spread, thing.friction + spread)))
    # A world that replaces hardware has one specific robot, not a distribution.
    spread = GAINS * width if bundle.kind == "twin" else 0.0
    gain = float(1 + spread * random.uniform(-1, 1))
    size = {name: _size(bundle, thing, random) for name, thing in bundle.objects.items()}
    return {"mass_scale": mass, "friction": friction, "gain_scale": gain, "size_scale": size}


def _size(bundle: TaskBundle, thing: TaskObject, random: Draws) -> float:
    """Draw a factor on the object's lengths within the 90 % interval; 1 if unknown."""
    if not thing.scale_sigma or bundle.kind != "twin":
        return 1.0
    error = float(np.clip(random.standard_normal(), -Z90, Z90))
    return float(np.exp(bundle.task.reset.dynamics * thing.scale_sigma * error))


def _rise(thing: TaskObject, size: float) -> float:
    """Height change of the origin of a resized object that stands in the same place [m]."""
    lowest = float((thing.points @ thing.pose.matrix[2, :3]).min())
    return (1.0 - size) * lowest


def _place_objects(bundle: TaskBundle, data: Any, sizes: dict[str, float], random: Draws) -> None:
    reset = bundle.task.reset
    for name, thing in bundle.objects.items():
        ours = name == bundle.task.object
        reach = reset.position_m if ours else reset.clutter_m
        shift = random.uniform(-reach, reach, 2)
        angle = float(random.uniform(-reset.yaw_rad, reset.yaw_rad)) if ours else 0.0
        error = _pose_error(bundle, thing, random)
        shift, angle = shift + error[:2], angle + float(error[2])
        turned = transforms.rigid(
            lie.about_z(angle) @ thing.pose.matrix[:3, :3],
            thing.pose.matrix[:3, 3] + [*shift, _rise(thing, sizes[name])],
        )
        place = data.joint(name).qpos
        place[:3], place[3:] = turned[:3, 3], quaternions.from_matrix(turned[:3, :3])
        for joint, position in zip(thing.joints, thing.positions, strict=True):
            wide = reset.joint_rad if ours else 0.0
            data.joint(joint).qpos[0] = position + random.uniform(-wide, wide)


def _pose_error(bundle: TaskBundle, thing: TaskObject, random: Draws) -> np.ndarray:
    """Draw x, y [m] and yaw [rad] from the covariance of the object's pose, (3,); zeros if unknown.

    Height and tilt are not drawn, because the support determines them. Only a twin's poses are estimates.
    """
    covariance = thing.pose.covariance
    if covariance is None or bundle.kind != "twin":
        return np.zeros(3)
    on_support = covariance[np.ix_((0, 1, 5), (0, 1, 5))]
    if isinstance(random, np.random.Generator):
        drawn = random.multivariate_normal(np.zeros(3), on_support, method="eigh")
    else:
        values, axes = np.linalg.eigh(on_support)
        drawn = axes @ (np.sqrt(np.maximum(values, 0.0)) * [random.standard_normal() for _ in range(3)])
    return np.asarray(bundle.task.reset.dynamics * drawn)


def _pose_robot(bundle: TaskBundle, model: Any, data: Any, random: Draws) -> None:
    targets: dict[str, float] = {}
    for joint in bundle.robot.joints:
        drawn = joint.home + random.uniform(-1, 1) * bundle.task.reset.robot_rad
        targets[joint.name] = float(np.clip(drawn, joint.lower, joint.upper))
        data.actuator(ROBOT + joint.name).ctrl[0] = targets[joint.name]
    for name, position in bundle.robot.followed(targets).items():
        data.joint(ROBOT + name).qpos[0] = position


def _places(bundle: TaskBundle, data: Any) -> dict[str, np.ndarray]:
    bodies = {name: data.body(name) for name in bundle.objects}
    return {name: transforms.rigid(body.xmat.reshape(3, 3), body.xpos)[None] for name, body in bodies.items()}


def _free(model: Any, data: Any) -> bool:
    """Whether no contact penetrates."""
    return data.ncon == 0 or bool(data.contact.dist[: data.ncon].min() > -TOUCH_M)


def _colliding(model: Any, data: Any) -> set[str]:
    """Pairs of penetrating bodies; a part of the static scene has the name of its geom."""
    found = set()
    for first, second in data.contact.geom[: data.ncon][data.contact.dist[: data.ncon] <= -TOUCH_M]:
        bodies = [int(model.geom_bodyid[geom]) for geom in (first, second)]
        names = [
            model.body(body).name if body else model.geom(geom).name or STATIC
            for body, geom in zip(bodies, (first, second), strict=True)
        ]
        found.add(" and ".join(sorted(names)))
    return found


def _off_support(bundle: TaskBundle, model: Any, data: Any) -> list[str]:
    """Objects whose origin is not above the support of the scene."""
    support = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, "static_support")
    if support < 0:
        return []
    rotation = data.geom_xmat[support].reshape(3, 3)
    found = []
    for name in bundle.objects:
        local = rotation.T @ (data.body(name).xpos - data.geom_xpos[support])
        if (np.abs(local[:2]) > model.geom_size[support][:2]).any():
            found.append(name)
    return found

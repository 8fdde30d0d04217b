"""Check of a task against the reach of the robot's arms, by lengths only; accepted tasks may still be out of reach."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.tasks.task import TaskBundle, TaskObject
from dextera_build.geometry import transforms
from dextera_build.sim.model import reach
from dextera_build.sim.model.reach import Ball
from dextera_build.sim.primitives import catalogue
from dextera_build.sim.primitives.base import UnfitError

SLACK_M = 0.15
"""Tolerance for sliding or falling after a release, and for pose and size variations of a start [m]."""


def check(bundle: TaskBundle) -> None:
    """Raise for a task whose object or target is beyond the reach of every limb that may do it.

    Raises:
        UnfitError: It is farther from the first joint than the fully extended arm.
    """
    primitive = catalogue.of(bundle.task, bundle.objects)
    named = bundle.task.limbs or primitive.ordered()[:1]
    found = {limb: reach.of_limb(bundle.robot, limb) for limb in named or bundle.robot.limb_names}
    limbs = {limb: own for limb, own in found.items() if own is not None}
    own, reset = bundle.objects[bundle.task.object], bundle.task.reset
    slack = _radius(own) + SLACK_M + np.sqrt(2.0) * reset.position_m
    _within(bundle, limbs, f"`{bundle.task.object}`", own.pose.matrix[:3, 3], slack, together=bool(named))
    target = primitive.target()
    if target is None:
        return
    near = primitive.near_m + sum(_radius(bundle.objects[name]) for name in primitive.others())
    slack = _radius(own) + SLACK_M + np.sqrt(2.0) * reset.goal_m + near
    _within(bundle, limbs, f"the target of `{bundle.task.name}`", np.array(target), slack, together=bool(named))


def _within(
    bundle: TaskBundle, limbs: dict[str, Ball], what: str, place: np.ndarray, slack: float, *, together: bool
) -> None:
    """Check one position (3,) in the world, NaN for free coordinates; `slack` is added to the reach [m]."""
    ways = {limb: _distance(bundle, own, place) for limb, own in limbs.items()}
    missed = [limb for limb, own in limbs.items() if ways[limb] > own.radius_m + slack]
    if not missed or (not together and len(missed) < len(limbs)):
        return
    limb = min(missed, key=lambda each: ways[each])
    at = ", ".join(f"{axis} {value:.2f}" for axis, value in zip("xyz", place, strict=True) if np.isfinite(value))
    raise UnfitError(
        f"{what} is out of reach of limb `{limb}`",
        place=f"{at} m in the world",
        distance=f"{ways[limb]:.2f} m from `{limbs[limb].joint}`",
        reach=f"at most {limbs[limb].radius_m:.2f} m of links and hand, and {slack:.2f} m of the object and tolerances",
        hint="move the robot with `position_m` of `align.base`, or change the goal",
    )


def _distance(bundle: TaskBundle, own: Ball, place: np.ndarray) -> float:
    """Smallest distance of a position from the limb's first joint [m]."""
    away = place - transforms.apply(bundle.base_pose.matrix, own.centre_m)
    return float(np.linalg.norm(np.nan_to_num(away)))


def _radius(thing: TaskObject) -> float:
    """Largest distance of an object's surface from its origin [m]."""
    return float(np.linalg.norm(thing.points, axis=1).max(initial=0.0))

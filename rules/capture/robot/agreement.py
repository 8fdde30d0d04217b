"""Consistency of recorded joint positions with a robot's model: names, order, units."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from dextera_build.artifacts.robots.robot import RobotJoint, RobotModel
from dextera_build.artifacts.spatial.joints import Joints
from dextera_build.errors import listing
from dextera_build.rule import Context

SLACK = 0.03
"""Tolerance of measurements beyond a limit [rad or m]."""
SHARE = 0.02
"""Largest fraction of the measurements beyond a limit."""
TURNS = 4 * float(np.pi)
"""Positions beyond two turns are unlikely to be radians [rad]."""
DEGREE = float(np.pi / 180)


def in_model_order(
    ctx: Context, joints: Joints, robot: RobotModel, names: Mapping[str, str], *, timed: bool = True
) -> Joints:
    """The columns of the robot's joints in the model's order.

    All joints of the arm must be present; of the hand all or none.

    Args:
        ctx: Context for errors and warnings.
        joints: As recorded.
        robot: The model.
        names: Recorded name -> the model's.
        timed: Whether the stamps belong to one motion, so that speeds can be checked.
    """
    unknown = [name for name in names if name not in joints.names]
    if unknown:
        ctx.fail(
            f"option `names` renames `{unknown[0]}`, which was not recorded",
            recorded=listing(joints.names, most=40),
            hint="write `names: {RECORDED: JOINT_OF_THE_MODEL}`",
        )
    known = {names.get(name, name): column for column, name in enumerate(joints.names)}
    wanted = [joint for joint in robot.joints if joint.name in known]
    missing = [joint for joint in robot.joints if joint.name not in known]
    hand = [joint for joint in robot.joints if joint.group == "hand"]
    if missing and (missing != hand or not wanted):
        _refuse_names(ctx, joints, robot, [joint.name for joint in missing])
    if missing:
        ctx.warn(f"the hand's {len(missing)} joints were not recorded, so where its fingers were is not known")
    columns = [known[joint.name] for joint in wanted]
    found = Joints(
        names=tuple(joint.name for joint in wanted),
        stamps=joints.stamps,
        positions=np.ascontiguousarray(joints.positions[:, columns]),
        velocities=None if joints.velocities is None else np.ascontiguousarray(joints.velocities[:, columns]),
    )
    _check_values(ctx, found, wanted, timed)
    return found


def doubt_units(ctx: Context, joints: Joints) -> None:
    """Warn of positions that are unlikely to be radians, if there is no model with limits."""
    top = np.abs(joints.positions).max(axis=0, initial=0.0)
    worst = int(top.argmax())
    if top[worst] > TURNS:
        ctx.warn(
            f"`{joints.names[worst]}` is at up to {top[worst]:.4g}: is that in degrees, or in millimetres? With "
            "`robot`, joint positions are checked against its model"
        )


def _refuse_names(ctx: Context, joints: Joints, robot: RobotModel, missing: Sequence[str]) -> None:
    extra = [name for name in joints.names if name not in {joint.name for joint in robot.joints}]
    near = {name: match[0] for name in missing if (match := difflib.get_close_matches(name, extra, n=1, cutoff=0.5))}
    if not near and len(extra) == len(missing):
        near = dict(zip(missing, extra, strict=True))
    spelled = ", ".join(f"{recorded}: {name}" for name, recorded in near.items())
    ctx.fail(
        f"the joint states lack {len(missing)} joints of the robot, `{missing[0]}` first",
        missing=listing(missing, most=40),
        recorded=listing(joints.names, most=40),
        hint=f"if they are the same joints, in this order: `names: {{{spelled}}}`"
        if near
        else "choose another topic, or write `names: {RECORDED: JOINT_OF_THE_MODEL}`",
    )


class _Outside(NamedTuple):
    """Joints with measurements beyond their limits."""

    shares: np.ndarray  # (J,) fraction of the measurements

    def __bool__(self) -> bool:
        return bool((self.shares > SHARE).any())


def _check_values(ctx: Context, joints: Joints, wanted: Sequence[RobotJoint], timed: bool) -> None:
    """Raise for positions beyond the robot's limits, with a likely explanation."""
    positions = joints.positions
    if not np.isfinite(positions).all():
        row, column = np.argwhere(~np.isfinite(positions))[0]
        ctx.fail(f"the position of `{joints.names[column]}` is not a number at {joints.stamps[row]:.3f} s")
    lower, upper = (np.array([getattr(joint, side) for joint in wanted]) for side in ("lower", "upper"))
    outside = _outside(positions, lower, upper)
    fast = _too_fast(joints, wanted) if timed else None
    if not outside and fast is None:
        return
    facts: dict[str, object] = {}
    for number in np.flatnonzero(outside.shares > SHARE)[:4]:
        low, high = positions[:, number].min(), positions[:, number].max()
        joint = wanted[number]
        facts[joint.name] = f"{low:.4g} to {high:.4g}, limits {joint.lower:.4g} to {joint.upper:.4g}"
    if fast is not None:
        facts["speed"] = fast
    why, hint = _explained(positions, lower, upper, [joint.name for joint in wanted])
    ctx.fail("the joint states are not those of this robot" + (f": {why}" if why else ""), hint=hint, **facts)


def _outside(positions: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> _Outside:
    return _Outside(((positions < lower - SLACK) | (positions > upper + SLACK)).mean(axis=0))


def _too_fast(joints: Joints, wanted: Sequence[RobotJoint]) -> str | None:
    """The joint with the highest speed relative to its limit, if it is twice as fast, over 0.1 s."""
    stamps = joints.stamps
    if len(stamps) < 3 or stamps[-1] - stamps[0] < 0.2:
        return None
    times = np.arange(stamps[0], stamps[-1], 0.1)
    moved = np.abs(np.diff([np.interp(times, stamps, each) for each in joints.positions.T], axis=1)) / 0.1
    top = np.quantile(moved, 0.98, axis=1)
    ratio = top / np.array([joint.velocity for joint in wanted])
    worst = int(ratio.argmax())
    if ratio[worst] <= 2.0:
        return None
    return f"`{wanted[worst].name}` moves at {top[worst]:.3g} per second, its limit is {wanted[worst].velocity:.3g}"


def _explained(
    positions: np.ndarray, lower: np.ndarray, upper: np.ndarray, names: Sequence[str]
) -> tuple[str, str | None]:
    """A transformation that would make the positions possible, with the remedy; empty if none is known."""
    as_degrees = np.abs(positions).max() > 2 * np.abs(np.stack([lower, upper])).max()
    if as_degrees and not _outside(DEGREE * positions, lower, upper):
        return "they fit as degrees", "record radians, or divide by 57.2958; a sliding joint has metres"
    for factor, unit in ((0.001, "millimetres"), (DEGREE, "degrees")):
        bad = _outside(positions, lower, upper).shares > SHARE
        scaled = np.where(bad, factor * positions, positions)
        if bad.any() and not _outside(scaled, lower, upper) and np.abs(positions[:, bad]).max() > 1 / factor / 100:
            wrong = listing(name for name, each in zip(names, bad, strict=True) if each)
            return f"{wrong} would fit as {unit}", "record radians, and metres for sliding joints"
    order = _other_order(positions, lower, upper)
    if order is not None:
        changed = [f"`{names[column]}` holds {names[place]}" for place, column in enumerate(order) if place != column]
        return (
            f"their columns fit in another order, e.g. {listing(changed)}",
            "check that names and positions were written in the same order",
        )
    return "", "check which robot and which topic this is; `names` assigns the joints"


def _other_order(positions: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> list[int] | None:
    """For each joint the column that fits its limits, with the fewest changes; None if there is no such order."""
    from scipy.optimize import linear_sum_assignment

    fits = np.array(
        [_outside(np.tile(column, (len(lower), 1)).T, lower, upper).shares <= SHARE for column in positions.T]
    )
    cost = np.where(fits.T, 1.0, 1000.0) - 0.5 * np.eye(len(lower))  # (joint, column)
    _, columns = linear_sum_assignment(cost)
    if not all(fits[column, joint] for joint, column in enumerate(columns)):
        return None
    return [int(column) for column in columns]

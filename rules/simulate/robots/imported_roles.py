"""Roles that a recipe adds to the files of a robot: links of the hand, named frames, actuated joints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Any

import numpy as np

from dextera_build.artifacts.robots.robot import Follower, Group, RobotJoint
from dextera_build.errors import listing
from dextera_build.rule import Context

if TYPE_CHECKING:
    from dextera_build.sim.model.imported.assembly import Placed, Plan

    from .imported_options import ImportedRobotOptions


@dataclass
class Roles:
    """Links, joints and frames of the whole robot."""

    links: dict[str, Group]
    """Link -> class."""
    joints: tuple[RobotJoint, ...]
    """Actuated joints."""
    followers: tuple[Follower, ...]
    """Joints that follow another joint."""
    plan: Plan
    """Additions of the assembly."""


def roles(
    ctx: Context, spec: Any, parts: list[Placed], sites: Mapping[str, Any], options: ImportedRobotOptions
) -> Roles:
    """Check the options against the existing bodies and joints.

    Args:
        ctx: Context for errors.
        spec: The `mujoco.MjSpec` of all bodies.
        parts: The descriptions, with their actuators.
        sites: Name of a site of the files, with prefix -> frame.
        options: Options of the rule.
    """
    from dextera_build.sim.model.imported.assembly import Drive, Plan, own_prefix

    links = _links(ctx, spec, options)
    known = {joint.name: joint for joint in spec.joints}
    for name in [*options.joints, *options.home_rad]:
        _check_known(ctx, name, known, "joint")
    mimics = _mimics(ctx, parts, known, options)
    driven = _driven(ctx, known, mimics, options)
    fixed = [name for name in known if name not in driven and name not in mimics]
    led = {name: rule for name, rule in mimics.items() if rule[0] in driven}
    fixed += [name for name in mimics if name not in led]
    facts = _Facts(ctx, parts, known, options)
    carriers = _carriers(spec, options)
    drives, joints = [], []
    for name in driven:
        lower, upper = facts.limits(name)
        effort, speed = facts.largest(name, "effort"), facts.largest(name, "velocity")
        stiffness, damping = facts.gains(name, effort)
        at = facts.home(name, lower, upper)
        drives.append(Drive(name, lower, upper, effort, stiffness, damping))
        carrier = known[name].parent.name
        group: Group = "arm" if carrier in carriers else links[carrier]
        joints.append(
            RobotJoint(
                name=name,
                group=group,
                lower=lower,
                upper=upper,
                velocity=speed,
                acceleration=facts.acceleration(name),
                effort=effort,
                home=at,
            )
        )
    home = {joint.name: joint.home for joint in joints}
    home |= {name: ratio * home[leader] + offset for name, (leader, ratio, offset) in led.items()}
    frames = {role: _frame(ctx, spec, sites, role, each) for role, each in options.frames.items()}
    for pair in options.apart:
        for name in pair:
            _check_known(ctx, name, links, "link")
    held = {name: facts.held(name) for name in fixed}
    followers = tuple(
        Follower(name=name, group=links[known[name].parent.name], leader=leader, ratio=ratio, offset=offset)
        for name, (leader, ratio, offset) in led.items()
    )
    drawn = {own_prefix(number) + name for number, part in enumerate(parts) for name in part.drawn}
    plan = Plan(drives, led, held, frames, list(options.apart), home, drawn)
    return Roles(links, tuple(joints), followers, plan)


def _links(ctx: Context, spec: Any, options: ImportedRobotOptions) -> dict[str, Group]:
    """Bodies in order; the hand consists of the named links and their descendants."""
    bodies = {body.name: body for body in spec.bodies[1:]}
    for name in options.hand:
        _check_known(ctx, name, bodies, "link")
    found: dict[str, Group] = {}
    for name, body in bodies.items():
        above = found.get(body.parent.name, "arm")
        found[name] = "hand" if name in options.hand or above == "hand" else "arm"
    if found.get("base") == "hand" and len(options.parts) > 1:
        ctx.fail("the base is part of the hand", hint="name the hand's first link in `hand`")
    return found


def _carriers(spec: Any, options: ImportedRobotOptions) -> set[str]:
    """Links from the base to each palm, whose joints move the whole hand, even if the link is itself a part of it."""
    bodies = {body.name: body for body in spec.bodies[1:]}
    palms = [each.link for role, each in options.frames.items() if role == "palm" or role.endswith("_palm")]
    found: set[str] = set()
    for name in palms:
        while name in bodies:
            found.add(name)
            name = bodies[name].parent.name
    return found


def _mimics(
    ctx: Context, parts: list[Placed], known: Mapping[str, Any], options: ImportedRobotOptions
) -> dict[str, tuple[str, float, float]]:
    """Joint -> the joint that it finally follows, ratio and offset."""
    stated = {
        part.prefix + name: (part.prefix + leader, ratio, offset)
        for part in parts
        for name, (leader, ratio, offset) in part.source.mimics.items()
        if part.prefix + name in known
    }
    for name, each in options.followers.items():
        _check_known(ctx, name, known, "joint")
        _check_known(ctx, each.leader, known, "joint")
        stated[name] = (each.leader, each.ratio, each.offset_rad)
    found = {}
    for name, (leader, ratio, offset) in stated.items():
        seen = {name}
        while leader in stated and leader not in seen:
            seen.add(leader)
            next_leader, more, shift = stated[leader]
            offset, ratio, leader = ratio * shift + offset, ratio * more, next_leader
        ctx.check(leader not in stated, f"joint `{name}` follows itself in the end", leader=leader)
        found[name] = (leader, ratio, offset)
    return found


def _driven(
    ctx: Context, known: Mapping[str, Any], mimics: Mapping[str, Any], options: ImportedRobotOptions
) -> list[str]:
    free = [name for name in known if name not in mimics]
    found = list(free)
    if options.active:
        for pattern in options.active:
            if not any(fnmatchcase(name, pattern) for name in free):
                _check_known(ctx, pattern, dict.fromkeys(free), "joint that moves by itself")
        found = [name for name in free if any(fnmatchcase(name, pattern) for pattern in options.active)]
    if not found:
        ctx.fail("no joint moves", hint="name a file whose joints are not all fixed")
    return found


def _frame(ctx: Context, spec: Any, sites: Mapping[str, Any], role: str, options: Any) -> Any:
    """A frame at a link, or at a site of the files."""
    from dextera_build.geometry import poses
    from dextera_build.sim.model.imported.assembly import Frame

    bodies = [body.name for body in spec.bodies[1:]]
    if options.link in bodies:
        return Frame(options.link, options.at_m, options.quaternion)
    if options.link not in sites:
        ctx.fail(
            f"frame `{role}` is on `{options.link}`, but no link or site is called so",
            links=listing(bodies, most=60),
            sites=listing(sites, most=40) or "none",
            hint=_near(options.link, [*bodies, *sites]),
        )
    site = sites[options.link]
    turn = np.array(options.quaternion) / np.linalg.norm(options.quaternion)
    first = poses.to_matrix(np.array([*site.place, *site.turn]))
    both = poses.from_matrix(first @ poses.to_matrix(np.array([*options.at_m, *turn])))
    return Frame(site.link, both[:3].tolist(), both[3:].tolist())


def _check_known(ctx: Context, name: str, known: Mapping[str, Any], kind: str) -> None:
    if name not in known:
        ctx.fail(
            f"no {kind} is called `{name}`",
            **{f"{kind.split()[0]}s": listing(known, most=60) or "none"},
            hint=_near(name, known) or f"name one of these {kind.split()[0]}s",
        )


def _near(name: str, known: Any) -> str | None:
    from dextera_build.errors import did_you_mean

    return did_you_mean(name, list(known))


class _Facts:
    """Properties of joints; the recipe overrides the files."""

    def __init__(
        self, ctx: Context, parts: list[Placed], known: Mapping[str, Any], options: ImportedRobotOptions
    ) -> None:
        self._ctx, self._known, self._options = ctx, known, options
        self._stated = {
            key: {part.prefix + name: value for part in parts for name, value in getattr(part.source, key).items()}
            for key in ("efforts", "speeds", "gains", "home")
        }

    def limits(self, name: str) -> tuple[float, float]:
        """Lower and upper limit."""
        own = self._options.joints.get(name)
        if own is not None and own.lower_rad is not None and own.upper_rad is not None:
            lower, upper = own.lower_rad, own.upper_rad
        else:
            import mujoco

            joint = self._known[name]
            low, high = (float(each) for each in joint.range)
            if joint.limited == mujoco.mjtLimited.mjLIMITED_FALSE or low >= high:
                without = [
                    each for each, other in self._known.items() if float(other.range[0]) >= float(other.range[1])
                ]
                self._ctx.fail(
                    f"joint `{name}` has no limits",
                    without=listing(without, most=40),
                    hint=f"`joints: {{{name}: {{lower_rad: -3.14, upper_rad: 3.14}}}}`",
                )
            lower, upper = low, high
        if lower >= upper:
            self._ctx.fail(f"the limits of joint `{name}` are in the wrong order", lower=lower, upper=upper)
        return lower, upper

    def largest(self, name: str, kind: str) -> float:
        """Maximum torque (`effort`) or speed (`velocity`)."""
        option = {"effort": "effort_nm", "velocity": "velocity_rad_s"}[kind]
        own = self._options.joints.get(name)
        stated = self._stated[{"effort": "efforts", "velocity": "speeds"}[kind]].get(name)
        values = (None if own is None else getattr(own, option), stated, getattr(self._options, option))
        known = next((float(value) for value in values if value is not None and value > 0), None)
        if known is None:
            self._ctx.fail(
                f"the largest {'torque' if kind == 'effort' else 'speed'} of joint `{name}` is not known",
                file="states none",
                hint=f"`{option}: 2.0` for all joints, or `joints: {{{name}: {{{option}: 2.0}}}}`",
            )
        return known

    def acceleration(self, name: str) -> float:
        """Maximum acceleration of targets."""
        own = self._options.joints.get(name)
        return (own.acceleration_rad_s2 if own is not None else None) or self._options.acceleration_rad_s2

    def gains(self, name: str, effort: float) -> tuple[float, float]:
        """Stiffness and damping of the position actuator."""
        from dextera_build.sim.model.imported.assembly import DAMPING, STIFFNESS

        own = self._options.joints.get(name)
        stiffness, damping = self._stated["gains"].get(name, (None, None))
        stiffness = own.stiffness_nm_rad if own is not None and own.stiffness_nm_rad is not None else stiffness
        damping = own.damping_nms_rad if own is not None and own.damping_nms_rad is not None else damping
        chosen = STIFFNESS * effort if stiffness is None else float(stiffness)
        return chosen, DAMPING * chosen if damping is None else float(damping)

    def home(self, name: str, lower: float, upper: float) -> float:
        """Home position."""
        if name in self._options.home_rad:
            value = self._options.home_rad[name]
            if not lower <= value <= upper:
                self._ctx.fail(
                    f"home of joint `{name}` is outside its limits",
                    home=f"{value:g}",
                    limits=f"{lower:g} to {upper:g}",
                    hint="positions are radians, of sliding joints metres",
                )
            return value
        return float(np.clip(self._stated["home"].get(name, 0.0), lower, upper))

    def held(self, name: str) -> float:
        """Fixed position of a joint that is not actuated."""
        return float(self._options.home_rad.get(name, self._stated["home"].get(name, 0.0)))

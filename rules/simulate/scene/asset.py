"""simulate.asset: one object in metres, usable in any simulator."""

from __future__ import annotations

import math

import numpy as np

from dextera_build.artifacts.objects import similar
from dextera_build.artifacts.objects.object import Asset, Body, Collision, Physics, Placement, Support
from dextera_build.artifacts.objects.view import Traits
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.rule import Context, rule
from dextera_build.statistics import Z90


@rule(version=3)
def asset(
    ctx: Context,
    body: Body,
    physics: Physics,
    collision: Collision,
    placement: Placement,
    traits: Traits,
    support: Support | None = None,
) -> Asset:
    """Return the body with the placement's scale applied to every part, and its pose in the world [m].

    A uniform scale s multiplies meshes, walls, pieces, joint origins and prismatic limits by s, masses by s^3 and
    inertias by s^5 at constant density; angles are unchanged. A weighed mass is kept, and its inertia scales with s^2.
    The pose is rigid, because simulators do not scale bodies. `support` defines the unit of the world, see
    `align.scale`. An uncertain scale widens the interval of the mass threefold.
    """
    names = set(body.links)
    for what, links in (("physics", set(physics.links)), ("collision", set(collision.links))):
        ctx.check(links == names, f"{what} has links {sorted(links)}, but the body has {sorted(names)}")
    factor, known = (1.0, "depth") if support is None else (support.factor, support.scale)
    s = placement.scale * factor
    ctx.check(bool(np.isfinite(s)) and s > 0.0, f"the scale is {s}, but it is positive")
    sized = similar.scaled(s)
    scaled = similar.widened(similar.physics(physics, sized), placement.scale_sigma)
    mass = sum(link.mass_kg for link in scaled.links.values())
    pieces = sum(len(link.hulls) for link in collision.links.values())
    ctx.metric("mass", mass, "kg")
    counts = f"{_count(pieces, 'collision piece')}, {_count(len(body.joints), 'joint')}"
    unknown = ", scale unknown" if known == "unknown" else ""
    scale_sigma = _scale_sigma(body, placement)
    pose = _moved(placement.pose, factor)
    ctx.say(
        f"{mass:.3f} kg, scale {s:.4f}, {counts}, {body.asset_source}{unknown}; {_intervals(scaled, pose, scale_sigma)}"
    )
    return Asset(
        body=similar.body(body, sized),
        physics=scaled,
        collision=similar.collision(collision, sized),
        pose=pose,
        category=traits.category,
        cut=traits.cut,
        asset_source=body.asset_source,
        scale=known,
        scale_sigma=scale_sigma,
    )


def _scale_sigma(body: Body, placement: Placement) -> float | None:
    """Standard deviation of the log of all lengths, from the placement's scale and the shape's own size."""
    if placement.scale_sigma is None:
        return None
    own = None if body.certainty is None else body.certainty.size_sigma
    return math.hypot(placement.scale_sigma, own or 0.0)


def _intervals(physics: Physics, pose: Pose, scale_sigma: float | None) -> str:
    """The 90 % intervals: `90 %: 176 to 584 g, scale ± 0.7 %, friction ± 0.20, position ± 1.2 mm, yaw ± 2.3 deg`."""
    low, high = (
        1000 * sum(getattr(link, end) for link in physics.links.values()) for end in ("mass_low_kg", "mass_high_kg")
    )
    parts = [f"{low:.0f} to {high:.0f} g"]
    parts.append("scale interval unknown" if scale_sigma is None else f"scale ± {100 * Z90 * scale_sigma:.1f} %")
    parts.append(f"friction ± {Z90 * physics.friction_sigma:.2f}")
    if pose.covariance is None:
        return "90 %: " + ", ".join([*parts, "pose interval unknown"])
    spread = Z90 * np.sqrt(np.diag(pose.covariance))
    turn = float(np.degrees(spread[5]))
    parts.append(f"position ± {1000 * float(spread[:2].max()):.1f} mm")
    parts.append(f"yaw ± {turn:.1f} deg" if turn < 90.0 else "yaw unknown")
    return "90 %: " + ", ".join(parts)


def _moved(pose: Pose, factor: float) -> Pose:
    matrix = pose.matrix.copy()
    matrix[:3, 3] *= factor
    covariance = pose.covariance
    if covariance is not None:
        units = np.diag([factor] * 3 + [1.0] * 3)
        covariance = units @ covariance @ units
    return pose.model_copy(update={"matrix": matrix, "covariance": covariance})


def _count(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"

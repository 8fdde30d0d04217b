"""simulate.asset: one object in metres, usable in any simulator."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.geometry import Hull, Mesh
from dextera_build.artifacts.object import (
    Asset,
    Body,
    Collision,
    Inertial,
    Joint,
    Link,
    Physics,
    Placement,
    Support,
)
from dextera_build.artifacts.pose import Pose
from dextera_build.artifacts.view import Traits
from dextera_build.rule import Context, rule


@rule(version=2)
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
    inertias by s^5 at constant density; angles are unchanged. A weighed mass stays, and its inertia goes with s^2. The
    pose is rigid, as simulators do not scale bodies. `support` says in which unit the world is, see `align.scale`.
    """
    names = set(body.links)
    for what, links in (("physics", set(physics.links)), ("collision", set(collision.links))):
        ctx.check(links == names, f"{what} has links {sorted(links)}, but the body has {sorted(names)}")
    factor, known = (1.0, "depth") if support is None else (support.factor, support.scale)
    s = placement.scale * factor
    ctx.check(bool(np.isfinite(s)) and s > 0.0, f"the scale is {s}, but it is positive")
    scaled = scale_physics(physics, s)
    mass = sum(link.mass_kg for link in scaled.links.values())
    pieces = sum(len(link.hulls) for link in collision.links.values())
    ctx.metric("mass", mass, "kg")
    counts = f"{_count(pieces, 'collision piece')}, {_count(len(body.joints), 'joint')}"
    unknown = ", scale unknown" if known == "unknown" else ""
    ctx.say(f"{mass:.3f} kg, scale {s:.4f}, {counts}, {body.asset_source}{unknown}")
    return Asset(
        body=scale_body(body, s),
        physics=scaled,
        collision=Collision(
            links={
                name: link.model_copy(update={"hulls": tuple(scale_hull(hull, s) for hull in link.hulls)})
                for name, link in collision.links.items()
            }
        ),
        pose=_moved(placement.pose, factor),
        category=traits.category,
        asset_source=body.asset_source,
        scale=known,
    )


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


def scale_body(body: Body, s: float) -> Body:
    """Scale the body by `s` about the object's origin, so its pose is unchanged."""
    links = {
        name: Link(mesh=scale_mesh(link.mesh, s), walls=tuple(scale_hull(wall, s) for wall in link.walls))
        for name, link in body.links.items()
    }
    joints = tuple(scale_joint(joint, s) for joint in body.joints)
    return body.model_copy(update={"links": links, "joints": joints})


def scale_joint(joint: Joint, s: float) -> Joint:
    """Scale the joint's origin, and its limits if they are lengths, by `s`."""
    length = s if joint.type == "prismatic" else 1.0
    x, y, z = joint.origin
    changes = {name: getattr(joint, name) * length for name in ("lower", "upper", "position")}
    return joint.model_copy(update={"origin": (x * s, y * s, z * s), **changes})


def scale_physics(physics: Physics, s: float) -> Physics:
    """Mass properties after scaling by `s` at constant density, or at constant mass if that was weighed."""
    grows = 1.0 if physics.weighed else s**3
    links = {name: _inertial(link, s, grows) for name, link in physics.links.items()}
    return physics.model_copy(update={"links": links})


def _inertial(link: Inertial, s: float, grows: float) -> Inertial:
    masses = {name: getattr(link, name) * grows for name in ("mass_kg", "mass_low_kg", "mass_high_kg")}
    vectors = {"centre": tuple(v * s for v in link.centre), "inertia": tuple(v * (grows * s**2) for v in link.inertia)}
    return link.model_copy(update={**masses, **vectors})


def scale_mesh(mesh: Mesh, s: float) -> Mesh:
    """Scale the mesh by `s`."""
    return mesh.model_copy(update={"vertices": _larger(mesh.vertices, s)})


def scale_hull(hull: Hull, s: float) -> Hull:
    """Scale the convex piece by `s`."""
    return Hull(vertices=_larger(hull.vertices, s))


def _larger(vertices: np.ndarray, s: float) -> np.ndarray:
    return (vertices.astype(np.float64) * s).astype(np.float32)

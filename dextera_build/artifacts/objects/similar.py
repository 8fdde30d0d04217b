"""Similarity transforms of all parts of an object.

X' = matrix @ [scale * X, 1] is applied consistently to geometry, joints, mass properties, collision pieces and
Gaussians, so that articulated objects remain functional. Lengths and limits of slides scale with s, angles are
unchanged; at constant density, masses scale with s^3 and moments of inertia with s^5. The scale is uniform, because a
hinge between parts stretched in one direction would no longer close.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from dextera_build.artifacts.objects.object import Asset, Body, Collision, Inertial, Joint, Link, Physics
from dextera_build.artifacts.shapes.mesh import Hull, Mesh
from dextera_build.artifacts.spatial.pose import Pose, Similarity
from dextera_build.geometry import massprops, transforms
from dextera_build.statistics import Z90

Triple: TypeAlias = tuple[float, float, float]
UNTOLD_SIGMA = 0.1
"""Standard deviation of the log scale, for the interval of the mass, if the placement states none."""


def scaled(scale: float, frame: str = "object") -> Similarity:
    """The similarity that scales about the origin without rotation."""
    return Similarity(parent=frame, child=frame, matrix=np.eye(4), scale=scale)


def asset(made: Asset, motion: Similarity) -> Asset:
    """The asset in another object frame and unit; its pose in the world is unchanged, except for its size."""
    return made.model_copy(
        update={
            "body": body(made.body, motion),
            "physics": physics(made.physics, motion),
            "collision": collision(made.collision, motion),
            "pose": _pose(made.pose, motion),
        }
    )


def body(made: Body, motion: Similarity) -> Body:
    """The body in another object frame and unit. Its pose in the world, if any, is that of the new frame.

    Scaling is about the old origin, so the pose of a body that is scaled without rotation is unchanged.
    """
    links = {
        name: Link(mesh=mesh(link.mesh, motion), walls=tuple(hull(wall, motion) for wall in link.walls))
        for name, link in made.links.items()
    }
    joints = tuple(joint(one, motion) for one in made.joints)
    pose = None if made.pose is None else _pose(made.pose, motion)
    return made.model_copy(update={"links": links, "joints": joints, "pose": pose})


def joint(made: Joint, motion: Similarity) -> Joint:
    """Origin and axis transformed; limits and position too if they are lengths."""
    length = motion.scale if made.type == "prismatic" else 1.0
    changes: dict[str, object] = {name: getattr(made, name) * length for name in ("lower", "upper", "position")}
    for name in ("lower_range", "upper_range"):
        if (interval := getattr(made, name)) is not None:
            changes[name] = tuple(end * length for end in interval)
    if made.origin_sigma_m is not None:
        changes["origin_sigma_m"] = made.origin_sigma_m * motion.scale
    changes["origin"] = _place(made.origin, motion)
    changes["axis"] = _triple(motion.matrix[:3, :3] @ np.array(made.axis))
    return made.model_copy(update=changes)


def physics(made: Physics, motion: Similarity) -> Physics:
    """Mass properties at constant density, or at constant mass if weighed."""
    grows = 1.0 if made.weighed else motion.scale**3
    links = {name: _inertial(link, motion, grows) for name, link in made.links.items()}
    return made.model_copy(update={"links": links})


def widened(made: Physics, scale_sigma: float | None) -> Physics:
    """Mass properties whose intervals include the uncertainty of the scale; weighed masses are unchanged.

    Args:
        made: Mass properties of the scaled body.
        scale_sigma: Standard deviation of the logarithm of its scale; None: `UNTOLD_SIGMA`.
    """
    if made.weighed:
        return made
    more = 3.0 * (UNTOLD_SIGMA if scale_sigma is None else scale_sigma)
    return made.model_copy(update={"links": {name: _widened(link, more) for name, link in made.links.items()}})


def _widened(link: Inertial, sigma: float) -> Inertial:
    if link.mass_low_kg <= 0.0:
        return link
    own = math.log(link.mass_high_kg / link.mass_low_kg) / (2.0 * Z90)
    factor = math.exp(Z90 * (math.hypot(own, sigma) - own))
    return link.model_copy(
        update={"mass_low_kg": link.mass_low_kg / factor, "mass_high_kg": link.mass_high_kg * factor}
    )


def collision(made: Collision, motion: Similarity) -> Collision:
    """All pieces of all links; volume ratios are unchanged."""
    moved = {
        name: link.model_copy(update={"hulls": tuple(hull(piece, motion) for piece in link.hulls)})
        for name, link in made.links.items()
    }
    return made.model_copy(update={"links": moved})


def mesh(made: Mesh, motion: Similarity) -> Mesh:
    """The mesh with its vertices transformed."""
    return made.model_copy(update={"vertices": _vertices(made.vertices, motion)})


def hull(made: Hull, motion: Similarity) -> Hull:
    """The convex piece with its vertices transformed."""
    return Hull(vertices=_vertices(made.vertices, motion))


def _vertices(vertices: np.ndarray, motion: Similarity) -> np.ndarray:
    return transforms.apply(motion.matrix, vertices.astype(np.float64) * motion.scale).astype(np.float32)


def _inertial(link: Inertial, motion: Similarity, grows: float) -> Inertial:
    changes: dict[str, object] = {
        name: getattr(link, name) * grows for name in ("mass_kg", "mass_low_kg", "mass_high_kg")
    }
    turn = motion.matrix[:3, :3]
    tensor = turn @ massprops.matrix(link.inertia) @ turn.T * (grows * motion.scale**2)
    return link.model_copy(update={**changes, "centre": _place(link.centre, motion), "inertia": massprops.six(tensor)})


def _place(point: Triple, motion: Similarity) -> Triple:
    return _triple(transforms.apply(motion.matrix, motion.scale * np.array([point]))[0])


def _triple(vector: np.ndarray) -> Triple:
    x, y, z = (float(value) for value in vector)
    return x, y, z


def _pose(pose: Pose, motion: Similarity) -> Pose:
    """T_world_new such that the old origin and the directions of the old axes are preserved."""
    back = Pose(parent=pose.child, child=pose.child, matrix=transforms.invert(motion.matrix))
    return pose @ back

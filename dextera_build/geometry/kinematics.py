"""Forward kinematics of an articulated object by the product of exponentials."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from dextera_build.errors import ArtifactError
from dextera_build.geometry import lie, transforms


class JointLike(Protocol):
    """Attributes of a joint that kinematics needs; `artifacts.object.Joint` has them."""

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def type(self) -> str: ...  # noqa: D102
    @property
    def parent(self) -> str: ...  # noqa: D102
    @property
    def child(self) -> str: ...  # noqa: D102
    @property
    def origin(self) -> tuple[float, float, float]: ...  # noqa: D102
    @property
    def axis(self) -> tuple[float, float, float]: ...  # noqa: D102
    @property
    def position(self) -> float: ...  # noqa: D102


class BodyLike(Protocol):
    """Attributes of a body that kinematics needs; `artifacts.object.Body` has them."""

    @property
    def links(self) -> Mapping[str, Any]: ...  # noqa: D102
    @property
    def joints(self) -> Sequence[JointLike]: ...  # noqa: D102


def joint_motion(joint: JointLike, position: float) -> np.ndarray:
    """The (4, 4) motion of all descendants of the joint, in the object frame, from position 0 to `position`.

    Args:
        joint: Axis and a point on it in the object frame [m], at position 0.
        position: Angle about the axis by the right-hand rule [rad], or distance along it [m].
    """
    axis = np.asarray(joint.axis, np.float64)
    axis = axis / np.linalg.norm(axis)
    if joint.type == "prismatic":
        return transforms.rigid(np.eye(3), axis * position)
    rotation = lie.about(axis, position)
    point = np.asarray(joint.origin, np.float64)
    return transforms.rigid(rotation, point - rotation @ point)


def link_poses(body: BodyLike, positions: Mapping[str, float] | None = None) -> dict[str, np.ndarray]:
    """Link -> (4, 4) T_object_link that moves the link's stored geometry (joints at 0) to its posed location.

    Args:
        body: Links and joints; geometry and axes in the object frame with every joint at 0.
        positions: Joint name -> position [rad or m]; other joints are at their own `position` (as photographed).

    Raises:
        ArtifactError: `positions` names an unknown joint, or the joints do not form a tree over the links.
    """
    given = dict(positions or {})
    known = [joint.name for joint in body.joints]
    if unknown := sorted(set(given) - set(known)):
        raise ArtifactError(f"`{unknown[0]}` is not a joint of this body", facts={"joints": ", ".join(known) or "none"})
    moved = {joint.child for joint in body.joints}
    poses = {name: np.eye(4) for name in body.links if name not in moved}
    waiting = list(body.joints)
    while waiting:
        ready = [joint for joint in waiting if joint.parent in poses]
        if not ready:
            names = ", ".join(joint.name for joint in waiting)
            raise ArtifactError(
                "the joints are not a tree over the links", code="DXB-A422", facts={"not reached": names}
            )
        for joint in ready:
            motion = joint_motion(joint, given.get(joint.name, joint.position))
            poses[joint.child] = poses[joint.parent] @ motion
        waiting = [joint for joint in waiting if joint not in ready]
    return poses


def posed_surface(body: BodyLike, positions: Mapping[str, float] | None = None) -> tuple[np.ndarray, np.ndarray]:
    """All links' triangles in the object frame, as posed: (V, 3) float64 [m] and (F, 3) int64, links by name."""
    poses = link_poses(body, positions)
    vertices: list[np.ndarray] = []
    faces: list[np.ndarray] = []
    count = 0
    for name in sorted(body.links):
        mesh = body.links[name].mesh
        vertices.append(transforms.apply(poses[name], mesh.vertices.astype(np.float64)))
        faces.append(mesh.faces.astype(np.int64) + count)
        count += len(mesh.vertices)
    return np.concatenate(vertices), np.concatenate(faces)

"""A body with its joints as they stand in the photograph."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.object import Body, Joint
from dextera_build.geometry import registration, transforms


def link_motions(body: Body) -> dict[str, np.ndarray]:
    """(4, 4) motion of every link, object frame, from joint position 0 to where it stands."""
    motions = {name: np.eye(4) for name in body.links if name not in {joint.child for joint in body.joints}}
    waiting = list(body.joints)
    while waiting:
        ready = [joint for joint in waiting if joint.parent in motions]
        if not ready:
            raise ValueError(f"the joints {[joint.name for joint in waiting]} hang on no link: the tree has a cycle")
        for joint in ready:
            motions[joint.child] = motions[joint.parent] @ _motion(joint)
            waiting.remove(joint)
    return motions


def surface(body: Body) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) float64 in the object frame and faces (F, 3) of all links as they stand."""
    motions = link_motions(body)
    vertices, faces, count = [], [], 0
    for name, link in body.links.items():
        vertices.append(transforms.apply(motions[name], link.mesh.vertices.astype(np.float64)))
        faces.append(link.mesh.faces + count)
        count += len(link.mesh.vertices)
    return np.concatenate(vertices), np.concatenate(faces)


def _motion(joint: Joint) -> np.ndarray:
    axis, origin = np.array(joint.axis), np.array(joint.origin)
    if joint.type == "prismatic":
        return transforms.rigid(np.eye(3), axis * joint.position)
    rotation = registration.rotation(axis * joint.position)
    return transforms.rigid(rotation, origin - rotation @ origin)

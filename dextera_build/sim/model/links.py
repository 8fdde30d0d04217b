"""Bodies of a compiled MuJoCo model as a tree of links with one joint each, as in ROS.

The frame of a link is at its joint, with the axes of its MuJoCo body at joint position 0. MuJoCo allows joints away
from a body's origin, and several in one body; the links between these have no shape.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any, Literal

import mujoco
import numpy as np

from dextera_build.geometry import poses, quaternions, transforms
from dextera_build.sim.model.sizes import HINGE, SLIDE


def ancestors(model: Any, body: int) -> list[int]:
    """A body and its ancestors in the kinematic tree, below the world."""
    way = [body]
    while above := int(model.body_parentid[way[-1]]):
        way.append(above)
    return way


@dataclass(frozen=True)
class Edge:
    """A link with its joint and parent."""

    parent: str
    """Link nearer to the root."""
    child: str
    """Moving link."""
    joint: str
    """Name of the joint; `<child>_fixed` for fixed ones."""
    type: Literal["fixed", "revolute", "prismatic"]
    """Kind of motion."""
    origin: np.ndarray
    """T_parent_child (4, 4) with the joint at 0."""
    axis: np.ndarray
    """Unit axis (3,) in the child's frame."""

    def at(self, positions: np.ndarray) -> np.ndarray:
        """Poses (T, 7) of the child in its parent at joint positions (T,) [rad or m]."""
        found = np.tile(poses.from_matrix(self.origin), (len(positions), 1))
        if self.type == "prismatic":
            found[:, :3] += np.outer(positions, self.origin[:3, :3] @ self.axis)
        elif self.type == "revolute":
            half = np.asarray(positions, np.float64)[:, None] / 2
            turns = np.concatenate([np.cos(half), np.sin(half) * self.axis], axis=1)
            found[:, 3:] = quaternions.multiply(found[:, 3:], turns)
        return found


@dataclass(frozen=True)
class Tree:
    """Some bodies of a model, as links."""

    edges: tuple[Edge, ...]
    """Edges from the root outwards."""
    shifts: dict[str, np.ndarray]
    """Body -> origin (3,) of its link in the frame of the body [m]; links without a body have none."""

    def sized(self, factor: float) -> Tree:
        """The tree with all lengths multiplied by `factor`."""
        if factor == 1.0:
            return self
        lengths = np.ones((4, 4))
        lengths[:3, 3] = factor
        edges = tuple(replace(edge, origin=edge.origin * lengths) for edge in self.edges)
        return Tree(edges, {body: factor * shift for body, shift in self.shifts.items()})

    @property
    def moving(self) -> tuple[Edge, ...]:
        """Movable edges."""
        return tuple(edge for edge in self.edges if edge.type != "fixed")


def tree(model: Any, root: str, *, prefix: str = "") -> Tree:
    """The links below a body, without the body's own joints.

    Args:
        model: The compiled model.
        root: Name of the body.
        prefix: Prefix of the names of bodies and joints in the model, removed in the tree.
    """
    data = mujoco.MjData(model)
    # The reference configuration of a model is not always that with all joints at 0.
    for joint in range(model.njnt):
        if int(model.jnt_type[joint]) in (HINGE, SLIDE):
            data.qpos[model.jnt_qposadr[joint]] = 0.0
    mujoco.mj_kinematics(model, data)
    first = int(model.body(root).id)
    frames = {first: transforms.rigid(data.xmat[first].reshape(3, 3).copy(), data.xpos[first].copy())}
    names, shifts, edges = {first: root.removeprefix(prefix)}, {root.removeprefix(prefix): np.zeros(3)}, []
    for body in range(first + 1, model.nbody):
        if int(model.body_parentid[body]) not in frames:
            continue
        above = int(model.body_parentid[body])
        made, frames[body] = _edges(model, data, body, names[above], frames[above], prefix)
        names[body] = made[-1].child
        turn = data.xmat[body].reshape(3, 3)
        shifts[names[body]] = turn.T @ (frames[body][:3, 3] - data.xpos[body])
        edges += made
    return Tree(tuple(edges), shifts)


def _edges(
    model: Any, data: Any, body: int, parent: str, frame: np.ndarray, prefix: str
) -> tuple[list[Edge], np.ndarray]:
    """The edges of a body's joints, and T_world_link of its link."""
    name = model.body(body).name.removeprefix(prefix) or f"body_{body}"
    turn = data.xmat[body].reshape(3, 3).copy()
    first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
    if count == 0:
        here = transforms.rigid(turn, data.xpos[body].copy())
        fixed = Edge(parent, name, f"{name}_fixed", "fixed", transforms.invert(frame) @ here, np.array([1.0, 0, 0]))
        return [fixed], here
    made = []
    for joint in range(first, first + count):
        here = transforms.rigid(turn, data.xanchor[joint].copy())
        title = model.joint(joint).name.removeprefix(prefix)
        child = name if joint == first + count - 1 else f"{name}_{title}"
        kind: Literal["revolute", "prismatic"] = "prismatic"
        if int(model.jnt_type[joint]) == HINGE:
            kind = "revolute"
        else:  # the anchor before the motion of the slide
            here[:3, 3] -= data.xaxis[joint] * model.qpos0[model.jnt_qposadr[joint]]
        made.append(Edge(parent, child, title, kind, transforms.invert(frame) @ here, model.jnt_axis[joint].copy()))
        parent, frame = child, here
    return made, frame


def poses_at(trees: Iterable[Tree], positions: Callable[[str], np.ndarray | None]) -> list[tuple[str, str, np.ndarray]]:
    """(parent, child, poses (T, 7)) of all movable edges.

    Args:
        trees: The links.
        positions: Joint -> positions (T,) [rad or m], or None if it was not recorded.
    """
    found = []
    for each in trees:
        for edge in each.moving:
            if (at := positions(edge.joint)) is not None:
                found.append((edge.parent, edge.child, edge.at(at)))
    return found

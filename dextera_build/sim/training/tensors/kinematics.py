"""Forward and inverse kinematics of a robot for many joint positions at once, on any device."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
import torch
from torch import Tensor

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.sim.model import robot as robots


class Kinematics:
    """Where sites of a robot are, and how its joints move them.

    Args:
        robot: The embodiment.
        names: Its joints in the order of positions.
        device: Of the tensors.
    """

    def __init__(self, robot: RobotModel, names: Sequence[str], device: torch.device) -> None:
        self._model = model = robots.load(robot.model).compile()
        self._device = device
        zero = robot.followed(dict.fromkeys(names, 0.0))
        self._row = {int(model.joint(name).id): row for row, name in enumerate(zero)}
        led = np.zeros((len(zero), len(names)))
        for column, name in enumerate(names):
            one = robot.followed(dict.fromkeys(names, 0.0) | {name: 1.0})
            led[:, column] = np.array(list(one.values())) - list(zero.values())
        self._led, self._rest = self._on(led), self._on(np.array(list(zero.values())))
        self._frames = [self._fixed(*each) for each in zip(model.body_pos, model.body_quat, strict=True)]
        self._own = [self._fixed(*each) for each in zip(model.site_pos, model.site_quat, strict=True)]
        """T_parent_body and T_body_site (4, 4)."""
        self._axes, self._anchors = self._on(model.jnt_axis), self._on(model.jnt_pos)

    def site(self, name: str) -> int:
        """The number of a site."""
        return int(self._model.site(name).id)

    def poses(self, joints: Tensor, sites: Sequence[int]) -> list[Tensor]:
        """T_base_site (N, 4, 4) of several sites at joint positions (N, A) [rad or m]."""
        moved, known = self._moved(joints), dict[int, Tensor]()
        return [self._body(int(self._model.site_bodyid[site]), moved, known)[0] @ self._own[site] for site in sites]

    def jacobian(self, joints: Tensor, site: int, columns: Tensor) -> tuple[Tensor, Tensor]:
        """T_base_site (N, 4, 4), and how some joints move it.

        Returns:
            The pose, and (N, 6, K): linear [m], then angular [rad], along the axes of the base, per joint in `columns`.
        """
        count, moved = len(joints), self._moved(joints)
        pose, axes = self._body(int(self._model.site_bodyid[site]), moved, {})
        pose = pose @ self._own[site]
        rows = torch.zeros(count, 6, len(self._led), device=self._device)
        for joint, axis, anchor in axes:
            if self._model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE:
                rows[:, :3, self._row[joint]] = axis
            else:
                rows[:, :3, self._row[joint]] = torch.linalg.cross(axis, pose[:, :3, 3] - anchor)
                rows[:, 3:, self._row[joint]] = axis
        return pose, rows @ self._led[:, columns]

    def _moved(self, joints: Tensor) -> Tensor:
        """Positions of all joints, with those that follow (N, J)."""
        return joints @ self._led.T + self._rest

    def _body(
        self, body: int, moved: Tensor, known: dict[int, Tensor]
    ) -> tuple[Tensor, list[tuple[int, Tensor, Tensor]]]:
        """T_base_body (N, 4, 4), and the joints on the way to it with their axes and anchors (N, 3) in the base."""
        found = torch.eye(4, device=self._device).expand(len(moved), 4, 4)
        axes: list[tuple[int, Tensor, Tensor]] = []
        chain = [body]
        while chain[-1]:
            chain.append(int(self._model.body_parentid[chain[-1]]))
        for each in reversed(chain[:-1]):
            # A body that was asked for before needs no second computation, unless its joints are asked for, too.
            if each in known:
                found = known[each]
                continue
            found = found @ self._frames[each]
            first = int(self._model.body_jntadr[each])
            for joint in range(first, first + int(self._model.body_jntnum[each])):
                axis, anchor = self._axes[joint], self._anchors[joint]
                axes.append((joint, found[:, :3, :3] @ axis, found[:, :3, :3] @ anchor + found[:, :3, 3]))
                found = found @ self._motion(joint, moved[:, self._row[joint]], axis, anchor)
            known[each] = found
        return found, axes

    def _motion(self, joint: int, at: Tensor, axis: Tensor, anchor: Tensor) -> Tensor:
        place = at - float(self._model.qpos0[self._model.jnt_qposadr[joint]])
        found = torch.eye(4, device=self._device).repeat(len(at), 1, 1)
        if self._model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE:
            found[:, :3, 3] = place[:, None] * axis
            return found
        found[:, :3, :3] = turn = rotation(place[:, None] * axis)
        found[:, :3, 3] = anchor - turn @ anchor
        return found

    def _fixed(self, place: np.ndarray, turn: np.ndarray) -> Tensor:
        matrix = np.zeros(9)
        mujoco.mju_quat2Mat(matrix, turn)
        found = np.eye(4)
        found[:3, :3], found[:3, 3] = matrix.reshape(3, 3), place
        return self._on(found)

    def _on(self, values: np.ndarray) -> Tensor:
        return torch.as_tensor(np.array(values), dtype=torch.float32, device=self._device)


def rotation(vectors: Tensor) -> Tensor:
    """Rotations (N, 3, 3) of rotation vectors (N, 3) [rad], by the formula of Rodrigues."""
    angle = vectors.norm(dim=1).clamp(min=1e-12)[:, None, None]
    cross = crosses(vectors / angle[:, 0])
    one = torch.eye(3, device=vectors.device)
    return one + torch.sin(angle) * cross + (1.0 - torch.cos(angle)) * (cross @ cross)


def crosses(vectors: Tensor) -> Tensor:
    """Matrices (N, 3, 3) whose products with v are `vectors` (N, 3) x v."""
    x, y, z = vectors.unbind(1)
    zero = torch.zeros_like(x)
    return torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=1).reshape(-1, 3, 3)


def rotation_vector(rotations: Tensor) -> Tensor:
    """Rotation vectors (N, 3) [rad] of (N, 3, 3), for angles below pi."""
    r = rotations
    twice = torch.stack([r[:, 2, 1] - r[:, 1, 2], r[:, 0, 2] - r[:, 2, 0], r[:, 1, 0] - r[:, 0, 1]], dim=1)
    sine = 0.5 * twice.norm(dim=1)
    angle = torch.atan2(sine, 0.5 * (r.diagonal(dim1=1, dim2=2).sum(1) - 1.0))
    return 0.5 * twice * torch.where(sine > 1e-6, angle / sine.clamp(min=1e-6), torch.ones_like(sine))[:, None]

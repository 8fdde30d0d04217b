"""What hands feel in many worlds at once: grasp states and forces on fingertips, from the contacts of all worlds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from dextera_build.sim.primitives.grasp import PRESS_N, SUPPORT
from dextera_build.sim.primitives.state import OPPOSING, GraspState
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.training.tensors.cells import cells
from dextera_build.sim.training.tensors.physics import Physics


class Touch:
    """The hands of the robot and the task's object.

    Args:
        environment: One world of the task.
        physics: All worlds.
    """

    def __init__(self, environment: Environment, physics: Physics) -> None:
        model, hands = environment.model, environment.hands
        self._physics, self._hands = physics, hands
        self._object = int(model.body(environment.task.object).id)
        device = physics.device
        self._fingers = torch.as_tensor(hands.fingers, device=device)
        self._ours = torch.as_tensor(model.body_rootid[model.geom_bodyid] == self._object, device=device)
        self._root = model.body_rootid.tolist()
        self._palms = [int(model.site_bodyid[site]) if site >= 0 else -1 for site in hands.palms]
        last = [hands.of(number).stop - 1 for number in range(len(hands.names))]
        self._tips = torch.as_tensor(np.delete(np.arange(hands.count), last), device=device)

    def read(self) -> tuple[dict[str, GraspState], Tensor]:
        """Limb -> grasp state of the object in its hand, and forces on the fingertips (N, F, 3) [N] in the world."""
        world, geoms, force = self._physics.contacts()
        one, other = self._fingers[geoms[:, 0]], self._fingers[geoms[:, 1]]
        apart = (one != other)[:, None] * force
        felt = self._summed(world, other, apart) - self._summed(world, one, apart)
        first, second = self._ours[geoms[:, 0]], self._ours[geoms[:, 1]]
        mine = torch.where(first[:, None], -force, force) * (first != second)[:, None]
        finger = torch.where(first, other, one)
        held = self._summed(world, finger, mine)
        rests = (finger == SUPPORT) & (mine.norm(dim=1) > PRESS_N)
        supported = torch.zeros(self._physics.count, device=world.device).index_add(0, world, rests.float()) > 0
        grasps = {name: self._grasp(number, held, supported) for number, name in enumerate(self._hands.names)}
        return grasps, felt[:, self._tips]

    def _summed(self, world: Tensor, finger: Tensor, force: Tensor) -> Tensor:
        """Forces (C, 3) added up by world and finger (N, H, 3), without those of nothing."""
        count = self._hands.count + 1  # the last one takes what is on no finger
        row = world * count + torch.where(finger == SUPPORT, torch.full_like(finger, count - 1), finger)
        total = torch.zeros(self._physics.count * count, 3, device=force.device).index_add(0, row, force)
        return total.reshape(-1, count, 3)[:, :-1]

    def _grasp(self, number: int, forces: Tensor, supported: Tensor) -> GraspState:
        own = forces[:, self._hands.of(number)]
        size = own.norm(dim=2)
        presses = size > PRESS_N
        unit = own / size.clamp(min=1e-12)[:, :, None] * presses[:, :, None]
        opposes = (unit @ unit.transpose(1, 2)).amin((1, 2)) < OPPOSING
        slip = torch.where(presses.any(1), self._slip(number), 0.0)
        parts: list[Any] = [cells(each) for each in (presses.sum(1), opposes, supported, slip, unit)]
        return GraspState(*parts)

    def _slip(self, number: int) -> Tensor:
        """Speed of the object's centre of mass relative to a rigid attachment to the palm (N,) [m/s]."""
        palm = self._palms[number]
        if palm < 0:
            return torch.zeros(self._physics.count, device=self._physics.device)
        place = self._physics["xipos"][:, self._object]
        moved, carried = (velocity_at(self._physics, self._root, body, place) for body in (self._object, palm))
        found: Tensor = torch.linalg.vector_norm(moved[:, :3] - carried[:, :3], dim=1)
        return found


def velocity_at(physics: Physics, root: Sequence[int], body: int, place: Tensor) -> Tensor:
    """Velocity (N, 6) of the points of a body at `place` (N, 3), in the world: linear [m/s], angular [rad/s]."""
    turning, moving = physics["cvel"][:, body, :3], physics["cvel"][:, body, 3:]
    centre = physics["subtree_com"][:, root[body]]
    return torch.cat([moving + torch.linalg.cross(turning, place - centre), turning], dim=1)

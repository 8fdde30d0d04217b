"""Distances of fingertips from what they should reach, in many worlds at once; see `sim.observe.progress`."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from dextera_build.sim.control.mechanism import Mechanism
from dextera_build.sim.model.compose import ROBOT
from dextera_build.sim.observe.progress import BEHIND_M, CLEAR_M, SHARE
from dextera_build.sim.primitives.state import TaskState
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.training.tensors.cells import Words, code
from dextera_build.sim.training.tensors.judge import TensorJudge
from dextera_build.sim.training.tensors.physics import Physics


class Reach:
    """The fingertips of the hands that may do the task.

    Args:
        environment: One world of the task.
        physics: All worlds.
    """

    def __init__(self, environment: Environment, physics: Physics) -> None:
        robot, model, self._physics = environment.bundle.robot, environment.model, physics
        device = physics.device
        roles = [name for name in environment.primitive.ordered() if name in robot.limbs]
        self._all = bool(environment.task.limbs)
        self._hands: dict[str, Tensor] = {}
        for name in roles or environment.task.limbs or robot.limb_names:
            limb = robot.limbs[name]
            sites = [model.site(ROBOT + robot.frames[role]).id for role in (limb.tips or (limb.palm,)) if role]
            if sites:
                self._hands[name] = torch.tensor(sites, device=device)
        points = environment.bundle.objects[environment.task.object].points
        self._points = torch.tensor(points.tolist(), dtype=torch.float32, device=device)
        self._links = {
            name: _Link(model, name, physics) for name in environment.bundle.objects[environment.task.object].joints
        }

    def distances(self, judge: TensorJudge, now: TaskState) -> Tensor:
        """Distances (N,) [m] of the hand from its target in the states `now`."""
        aim, way = judge.aims(now)
        sites = self._physics["site_xpos"]
        if way is not None:
            tips = torch.cat([sites[:, hand] for hand in self._hands.values()], dim=1)
            far = torch.zeros(len(tips), device=tips.device)
            for name, link in self._links.items():
                far = torch.where(_is(aim, name, tips), link.distances(way.as_subclass(Tensor), tips).amin(1), far)
            return far
        pose: Any = now.world_from_object
        pose = pose.as_subclass(Tensor)
        means = {}
        for name, hand in self._hands.items():
            local = (sites[:, hand] - pose[:, None, :3, 3]) @ pose[:, :3, :3]
            means[name] = torch.cdist(local, self._points, compute_mode="donot_use_mm_for_euclid_dist").amin(2).mean(1)
        each = torch.stack(list(means.values()))
        far = each.mean(0) if self._all else each.amin(0)
        if aim is not None:
            for name, mean in means.items():
                far = torch.where(_is(aim, name, mean), mean, far)
        return far


def _is(words: Any, word: str, like: Tensor) -> Tensor:
    """Whether words (N,) are `word`; the words of a task with one joint are an array."""
    if isinstance(words, Words):
        return words.codes == code(word)
    return torch.full((len(like),), bool(words[0] == word), device=like.device)


class _Link:
    """Distances of fingertips from a push of a joint's link from behind, at the size in the photograph."""

    def __init__(self, model: Any, joint: str, physics: Physics) -> None:
        mechanism = Mechanism(model, joint)
        self._physics, self._turns = physics, mechanism.turns
        self._body = int(model.jnt_bodyid[model.joint(joint).id])
        ways = []
        for sign in (-1.0, 1.0):
            place, along = mechanism.pushed_at(sign, SHARE)
            outwards = np.cross(along, mechanism.axis) * sign
            outwards *= np.sign(outwards @ (place - mechanism.pivot))
            ways.append([place, place - BEHIND_M * along, along, CLEAR_M * outwards])
        self._ways = torch.tensor(np.array(ways).tolist(), device=physics.device)
        """By direction: contact point, the point behind it, direction of the push, way around the edge; (2, 4, 3)."""

    def distances(self, way: Tensor, points: Tensor) -> Tensor:
        """Lengths (N, T) [m] of paths from points (N, T, 3) of the world, as `observe.progress` has them."""
        turn = self._physics["xmat"][:, self._body].reshape(-1, 3, 3)
        place = self._physics["xpos"][:, self._body]
        own = self._ways[(way > 0).long()] @ turn.transpose(1, 2)
        surface, target = (own[:, None, row] + place[:, None] for row in (0, 1))
        straight: Tensor = torch.linalg.vector_norm(points - target, dim=2)
        if not self._turns:
            return straight
        edge = target + own[:, None, 3]
        around = (points - edge).norm(dim=2) + (edge - target).norm(dim=2)
        before = ((points - surface) * own[:, None, 2]).sum(2) > 0
        return torch.where(before, around, straight)

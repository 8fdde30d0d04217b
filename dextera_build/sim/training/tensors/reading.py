"""States, observations and privileged numbers of many worlds, read from MuJoCo Warp as tensors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from dextera_build.artifacts.tasks.policy import Channel, PolicyContract
from dextera_build.errors import RuleError, listing
from dextera_build.geometry import transforms
from dextera_build.policy.layout import of_bundle
from dextera_build.sim.model.compose import ROBOT
from dextera_build.sim.primitives.state import TaskState
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.training.insight import FORCE_N, PLACE_M
from dextera_build.sim.training.tensors.cells import cells
from dextera_build.sim.training.tensors.physics import Physics
from dextera_build.sim.training.tensors.touch import Touch, velocity_at


@dataclass(frozen=True)
class Episodes:
    """What the readings of worlds depend on beside the simulator."""

    steps: Tensor
    """Control periods since the start (N,)."""
    sent: Tensor
    """Last joint targets (N, A) [rad]."""
    base: Tensor
    """T_world_base (N, 4, 4), with the error of the start."""
    value: Tensor
    """Value of the states (N,)."""


class Reading:
    """What is measured in N worlds.

    Args:
        environment: One world of the task.
        physics: All worlds.
        contract: The policy's inputs.
        limbs: The limbs that it moves.

    Raises:
        RuleError: An input is not made on tensors.
    """

    def __init__(
        self, environment: Environment, physics: Physics, contract: PolicyContract, limbs: tuple[str, ...]
    ) -> None:
        self._environment, self._physics, self._inputs = environment, physics, contract.inputs
        self._touch = Touch(environment, physics)
        model, bundle, device = environment.model, environment.bundle, physics.device
        robot = bundle.robot
        names = [ROBOT + joint.name for joint in robot.joints]
        self.joints = torch.tensor([int(model.joint(name).qposadr[0]) for name in names], device=device)
        """Places of the robot's joints in `qpos`."""
        self._dofs = torch.tensor([int(model.joint(name).dofadr[0]) for name in names], device=device)
        within = [int(model.joint(name).qposadr[0]) for name in bundle.displacement_names]
        self._within = torch.tensor(within, dtype=torch.int64, device=device)
        bodies = [int(model.body(name).id) for name in bundle.objects]
        self._bodies, self._objects = bodies, torch.tensor(bodies, device=device)
        self._target = int(model.body(environment.task.object).id)
        self._others = {name: int(model.body(name).id) for name in environment.primitive.others()}
        self._inner = [(name, model.joint(name)) for name in bundle.objects[environment.task.object].joints]
        self._ranges = {name: self._on(model.jnt_range[joint.id]) for name, joint in self._inner}
        self._root = model.body_rootid.tolist()
        self._known = self._on(transforms.invert(bundle.base_pose.matrix))
        self._goal = self._on(environment.goal)
        self._middle = self._on(bundle.objects[environment.task.object].points.astype(np.float64).mean(axis=0))
        self._palms, self._tips = environment.hands.palms, torch.tensor(environment.hands.tips, device=device)
        self._acting = torch.tensor([robot.limb_names.index(limb) for limb in limbs], device=device)
        own = [number for number, name in enumerate(robot.limb_names) for _ in robot.limbs[name].tips]
        self._own = torch.tensor(own, device=device)
        layout = of_bundle(bundle)
        self._rows = {
            channel.name: torch.tensor(
                [(layout.names(channel.name) or ()).index(name) for name in channel.names], device=device
            )
            for channel in contract.inputs
        }
        known = {"joints", "previous_action", "objects", "displacement", "goal"}
        if unknown := [channel.name for channel in contract.inputs if channel.name not in known]:
            raise RuleError(
                f"worlds on tensors do not observe `{unknown[0]}`",
                code="DXB-B535",
                facts={"they observe": listing(sorted(known))},
                hint="leave it out of `inputs`, or train with the backend `sb3`",
            )
        self._scales = {channel.name: self._scale(channel) for channel in contract.inputs}

    def state(self, episodes: Episodes) -> TaskState:
        """The quantities that determine success, as `Environment.state` of every world."""
        physics, count = self._physics, self._physics.count
        grasps = self._touch.read()[0] if self._environment.primitive.feels else {}
        parts: dict[str, Any] = {
            "time_s": episodes.steps * self._environment.period_s,
            "world_from_object": self._pose(self._target),
            "others": {name: cells(self._pose(body)) for name, body in self._others.items()},
            "joints": {name: cells(physics["qpos"][:, joint.qposadr[0]].clone()) for name, joint in self._inner},
            "ranges": {name: cells(each.expand(count, 2)) for name, each in self._ranges.items()},
            "speeds": {name: cells(physics["qvel"][:, joint.dofadr[0]].clone()) for name, joint in self._inner},
            "grasps": grasps,
        }
        state: Any = TaskState  # whose arrays are tensors here
        found: TaskState = state(**{name: cells(x) if isinstance(x, Tensor) else x for name, x in parts.items()})
        return found

    def inputs(self, episodes: Episodes) -> Tensor:
        """The policy's inputs, normalised and flat (N, K)."""
        read: dict[str, Callable[[], Tensor]] = {
            "joints": lambda: self._physics["qpos"][:, self.joints],
            "previous_action": lambda: episodes.sent,
            "objects": self._poses,
            "displacement": lambda: self._physics["qpos"][:, self._within],
            "goal": lambda: self._goal.expand(self._physics.count, -1),
        }
        parts = []
        for channel in self._inputs:
            values = read[channel.name]()[:, self._rows[channel.name]].reshape(self._physics.count, -1)
            mean, scale = self._scales[channel.name]
            parts.append((values - mean) / scale)
        return torch.cat(parts, dim=1)

    def insight(self, episodes: Episodes) -> Tensor:
        """What only critics and teachers see (N, P), as `sim.training.insight`."""
        physics, count = self._physics, self._physics.count
        turn = episodes.base[:, :3, :3]  # a row vector of the world times it is in the base
        sites, world = physics["site_xpos"], episodes.base[:, None, :3, 3]
        hands = [
            (sites[:, palm : palm + 1] - world) @ turn if palm >= 0 else sites[:, :1] * 0.0 for palm in self._palms
        ]
        palms = torch.cat(hands, dim=1)
        tips = (sites[:, self._tips] - world) @ turn
        twists = [velocity_at(physics, self._root, body, physics["xpos"][:, body]) for body in self._bodies]
        moving = torch.stack(twists, dim=1).reshape(count, -1, 3) @ turn
        pose = self._pose(self._target)
        middle = ((pose[:, :3, :3] @ self._middle + pose[:, :3, 3])[:, None] - world) @ turn
        timeout = self._environment.task.timeout_s
        parts = [
            torch.tanh(self._touch.read()[1] @ turn / FORCE_N),
            physics["qvel"][:, self._dofs],
            moving,
            (tips - palms[:, self._own]) / PLACE_M,
            (middle - palms[:, self._acting]) / PLACE_M,
            episodes.steps[:, None] * (self._environment.period_s / timeout),
            episodes.value[:, None],
        ]
        return torch.cat([part.reshape(count, -1) for part in parts], dim=1).clamp(-5.0, 5.0)

    def broken(self) -> Tensor:
        """Whether a speed is beyond any sense, or not a number (N,)."""
        return ~(self._physics["qvel"].abs().amax(1) <= 1e4)

    def _poses(self) -> Tensor:
        """Positions and first two columns of the rotations of all objects in the known base (N, O, 9)."""
        turn = self._known[:3, :3]
        places = self._physics["xpos"][:, self._objects] @ turn.T + self._known[:3, 3]
        columns = (turn @ self._physics["xmat"][:, self._objects])[..., :2].transpose(2, 3)
        return torch.cat([places, columns.reshape(*places.shape[:2], 6)], dim=2)

    def _pose(self, body: int) -> Tensor:
        """T_world_body (N, 4, 4)."""
        found = torch.eye(4, device=self._physics.device).repeat(self._physics.count, 1, 1)
        found[:, :3, :3], found[:, :3, 3] = self._physics["xmat"][:, body], self._physics["xpos"][:, body]
        return found

    def _scale(self, channel: Channel) -> tuple[Tensor | float, Tensor | float]:
        return (self._on(channel.mean), self._on(channel.scale)) if channel.scale else (0.0, 1.0)

    def _on(self, values: Any) -> Tensor:
        return torch.tensor(np.asarray(values).tolist(), dtype=torch.float32, device=self._physics.device)

"""The decisions of `sim.control.steering` in many worlds at once; rounding and the end of the last steps differ."""

from __future__ import annotations

import torch
from torch import Tensor

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.tasks.policy import PolicyContract
from dextera_build.geometry import quaternions
from dextera_build.sim.control import ik, steering
from dextera_build.sim.training.tensors.kinematics import Kinematics, crosses, rotation, rotation_vector

DAMPED = 1e-3
"""Damping of a step by the squared error, as of the task of a frame in `ik.ArmKinematics`."""

ROUNDS = 4
"""Solutions of the normal equations of one step, each with the joints that left their ranges fixed at the limits."""


class TensorSteering:
    """Maps decisions (N, M), each -1 to 1, to joint targets, see `steering.Steering`.

    Args:
        robot: The embodiment.
        contract: The policy's contract.
        device: Of the tensors.
    """

    def __init__(self, robot: RobotModel, contract: PolicyContract, device: torch.device) -> None:
        self._plain = plain = steering.Steering(robot, contract)
        self._device, self.size, self.every, self.limbs = device, plain.size, plain.every, plain.limbs
        settings, names = contract.settings, contract.action.names
        self._step_m, self._step_rad = float(settings["step_m"]), float(settings["step_rad"])
        self._lead, self._turn_rad = float(settings["lead_rad"]), float(settings.get("turn_rad", 0.0))
        self._rest = self._on(contract.action.mean)
        self._each = 6 if self._turn_rad else 3
        single = str(settings["joints"]).split()
        self._single = torch.tensor([names.index(name) for name in single], dtype=torch.int64, device=device)
        kinematics = Kinematics(robot, names, device)
        turn = [float(settings[f"palm_{part}"]) for part in "wxyz" if f"palm_{part}" in settings]
        palm = settings["control"] == "palm"
        self._palms = [_Palm(robot, limb, names, self._rest, turn, kinematics) for limb in self.limbs] if palm else []
        grips = zip(self.limbs, str(settings.get("grip", "")).split(), strict=False)
        closed = [robot.limbs[limb].grips[grip].closed for limb, grip in grips]
        rest = contract.action.mean
        moved = [
            [name for name, end in each.items() if name in names and end != rest[names.index(name)]] for each in closed
        ]
        self._fingers = [torch.tensor([names.index(name) for name in each], device=device) for each in moved]
        self._ways = [
            self._on([end[name] for name in each]) - self._rest[fingers]
            for end, each, fingers in zip(closed, moved, self._fingers, strict=True)
        ]
        parts = [*(each.arm for each in self._palms), *self._fingers, self._single]
        self._moved = torch.cat(parts)

    def places(self, joints: Tensor) -> Tensor:
        """Palms and mean fingertips (N, 6 * palms) at joint positions (N, A), as `Steering.numbers` has them."""
        found = [palm.places(joints) for palm in self._palms]
        return torch.cat(found, dim=1) if found else joints[:, :0]

    def targets(self, decisions: Tensor, sent: Tensor, joints: Tensor) -> Tensor:
        """Joint targets (`every`, N, A) [rad] for the next control periods.

        Args:
            decisions: Outputs of the network (N, M).
            sent: Last targets (N, A) [rad].
            joints: Positions of the joints (N, A) [rad].
        """
        wanted = decisions.clamp(-1.0, 1.0)
        goal = self._rest.repeat(len(sent), 1)
        goal[:, self._single] = sent[:, self._single] + self._step_rad * wanted[:, self.size - len(self._single) :]
        for number, palm in enumerate(self._palms):
            way = wanted[:, number * self._each : (number + 1) * self._each]
            turn = self._turn_rad * way[:, 3:] if self._turn_rad else None
            change = palm.moved(sent, self._step_m * way[:, :3], turn) - sent[:, palm.arm]
            goal[:, palm.arm] = sent[:, palm.arm] + change.clamp(-self._step_rad, self._step_rad)
        first = len(self._palms) * self._each
        for number, (fingers, way) in enumerate(zip(self._fingers, self._ways, strict=True)):
            opened = self._rest[fingers]
            share = (sent[:, fingers] - opened) @ way / (way @ way) + steering.CLOSING * wanted[:, first + number]
            goal[:, fingers] = opened + share.clamp(0.0, 1.0)[:, None] * way
        moved = self._moved
        goal[:, moved] = goal[:, moved].clamp(joints[:, moved] - self._lead, joints[:, moved] + self._lead)
        found = goal.repeat(self.every, 1, 1)
        shares = torch.arange(1, self.every + 1, device=self._device)[:, None, None] / self.every
        found[:, :, moved] = sent[:, moved] + (goal - sent)[:, moved] * shares
        return found

    def _on(self, values: object) -> Tensor:
        return torch.tensor(values, dtype=torch.float32, device=self._device)


class _Palm:
    """The palm of a limb: where it is, and joints that move it."""

    def __init__(
        self,
        robot: RobotModel,
        limb: str,
        names: tuple[str, ...],
        home: Tensor,
        turn: list[float],
        kinematics: Kinematics,
    ) -> None:
        own = robot.limbs[limb]
        arm = [joint for joint in robot.joints if joint.name in own.arm]
        device = home.device
        self.arm = torch.tensor([names.index(joint.name) for joint in arm], device=device)
        self._lower, self._upper = torch.tensor([(each.lower, each.upper) for each in arm], device=device).T
        self._kinematics, self._home = kinematics, home
        self._palm, *self._tips = (
            kinematics.site(robot.frames[role]) for role in (own.palm, *(own.tips or (own.palm,)))
        )
        self._weights = torch.tensor([1.0] * 3 + [steering.RADIAN_M] * 3, device=device)
        self._origin = self._points(home[None])
        fixed = torch.tensor(quaternions.to_matrix(torch.tensor(turn).numpy()), device=device) if turn else None
        upright = fixed if fixed is not None else kinematics.poses(home[None], [self._palm])[0][0, :3, :3]
        self._upright = upright.to(torch.float32)

    def moved(self, joints: Tensor, way: Tensor, turn: Tensor | None) -> Tensor:
        """Arm joints (N, J) [rad] that move the palms from their poses at `joints` (N, A); see `steering`."""
        found, columns = joints.clone(), self.arm
        (start,) = self._kinematics.poses(joints, [self._palm])
        goal = start[:, :3, 3] + way
        upright = rotation(turn) @ start[:, :3, :3] if turn is not None else self._upright
        posture_cost = steering.DAMPING**2
        for _ in range(steering.ITERATIONS):
            pose, rows = self._kinematics.jacobian(found, self._palm, columns)
            own = pose[:, :3, :3].transpose(1, 2)
            left = rotation_vector(own @ upright)
            left = left * (steering.TURN_RAD / left.norm(dim=1, keepdim=True).clamp(min=1e-9)).clamp(max=1.0)
            away = (own @ (goal - pose[:, :3, 3])[:, :, None])[:, :, 0]
            error, change = _twist(away, left)
            rows = change @ torch.cat([own @ rows[:, :3], own @ rows[:, 3:]], dim=1) * self._weights[:, None]
            weighted = error * self._weights
            at = found[:, columns]
            damped = DAMPED * (weighted * weighted).sum(1) + ik.DAMPING + posture_cost
            hessian = rows.transpose(1, 2) @ rows + torch.diag_embed(damped[:, None].expand(-1, at.shape[1]))
            pull = posture_cost * steering.POSTURE * (self._home[columns] - at)
            right = (rows.transpose(1, 2) @ weighted[:, :, None])[:, :, 0] + pull
            found[:, columns] = at + _bounded(hessian, right, self._lower - at, self._upper - at)
        return found[:, columns]

    def places(self, joints: Tensor) -> Tensor:
        """Palm and mean fingertip (N, 6) in the base, relative to home, in units of `PLACE_M`."""
        return (self._points(joints) - self._origin) / steering.PLACE_M

    def _points(self, joints: Tensor) -> Tensor:
        palm, *tips = (each[:, :3, 3] for each in self._kinematics.poses(joints, [self._palm, *self._tips]))
        return torch.cat([palm, torch.stack(tips).mean(0)], dim=1)


def _twist(away: Tensor, turn: Tensor) -> tuple[Tensor, Tensor]:
    """The twist (N, 6) of a motion by `away` (N, 3) and a rotation vector (N, 3), and its change (N, 6, 6) per motion.

    The series of the logarithm on SE(3) and of its Jacobian up to second order, of rotations up to `TURN_RAD`.
    """
    across, one = crosses(turn), torch.eye(6, device=away.device)
    inverse = one[:3, :3] - 0.5 * across + across @ across / 12.0
    straight = (inverse @ away[:, :, None])[:, :, 0]
    zero = torch.zeros_like(across)
    adjoint = torch.cat([torch.cat([across, crosses(straight)], 2), torch.cat([zero, across], 2)], 1)
    return torch.cat([straight, turn], dim=1), one - 0.5 * adjoint + adjoint @ adjoint / 12.0


def _bounded(hessian: Tensor, right: Tensor, lower: Tensor, upper: Tensor) -> Tensor:
    """The least of x H x / 2 - r x within bounds (N, J): what leaves them is put on them, and the rest solved again."""
    fixed, step = torch.zeros_like(right, dtype=torch.bool), torch.zeros_like(right)
    one = torch.eye(right.shape[1], device=right.device)
    for _ in range(ROUNDS):
        free = (~fixed).to(right.dtype)
        reduced = hessian * free[:, :, None] * free[:, None, :] + one * (1.0 - free)[:, :, None]
        rest = right - (hessian @ (step * (1.0 - free))[:, :, None])[:, :, 0]
        # Without a check of the result, which would copy to the host; the matrix is positive by its diagonal.
        factor, _ = torch.linalg.cholesky_ex(reduced)
        solved = torch.cholesky_solve((rest * free)[:, :, None], factor)[:, :, 0]
        step = torch.where(fixed, step, solved)
        bounded = torch.minimum(torch.maximum(step, lower), upper)
        fixed, step = fixed | (bounded != step), bounded
    return step

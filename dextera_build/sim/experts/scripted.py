"""Shared by scripted operators: a plan is made at the start of an episode and followed to its end."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator

import numpy as np

from dextera_build.geometry import transforms
from dextera_build.sim.control.operator import Command, State
from dextera_build.sim.experts.motion import Leg
from dextera_build.sim.experts.reach import Reach
from dextera_build.sim.runtime.environment import Environment


class Scripted(ABC):
    """Follows the plan that it makes of the first state.

    Args:
        environment: The task; only its data are used.
        reach: Kinematics of a limb.
    """

    def __init__(self, environment: Environment, reach: Reach) -> None:
        self._object, self._rate = environment.task.object, environment.task.control_hz
        self._reach = reach
        self._commands: Iterator[Command] = iter(())

    def begin(self, state: State) -> None:
        """Plan from `state`."""
        legs = self.legs(state)
        self._reach.check(self._checked(legs), state)
        self._commands = self._reach.commands(legs, state, self._rate)

    def command(self, state: State) -> Command | None:
        """The next step of the plan."""
        return next(self._commands, None)

    @abstractmethod
    def legs(self, state: State) -> list[Leg]:
        """The plan from `state`."""

    def _checked(self, legs: list[Leg]) -> list[Leg]:
        """The legs whose ends the arm must reach."""
        return legs


class Pushing(Scripted):
    """Pushes with the fingertips: over, down behind, touch, many short legs along the way, and a last one."""

    def __init__(self, environment: Environment, reach: Reach) -> None:
        super().__init__(environment, reach)
        grip = next(grip for grip in reach.grips.values() if grip.against == "nothing")
        self._fingers = reach.fingers.posture(grip.open)
        self._pad, self._tip = reach.fingers.reach(self._fingers), grip.tip_radius_m
        # Axes of the hand, in the palm's frame: along the fingers, out of the palm, and across.
        along, out = np.array(grip.pointing), np.array(grip.facing)
        self._axes = np.stack([along, out, np.cross(along, out)])

    def _checked(self, legs: list[Leg]) -> list[Leg]:
        return [*legs[:3], *legs[3:-1:8], legs[-1]]

    def _pushes(self, palm: np.ndarray, seconds: float) -> Leg:
        return Leg(palm, self._fingers, seconds, "push", self._object, True)

    def _palm(self, turn: np.ndarray, tip: np.ndarray) -> np.ndarray:
        """Pose (4, 4) of the palm with rotation `turn` (3, 3) and the fingertips at `tip` (3,)."""
        return transforms.rigid(turn, tip - turn @ self._pad)

    def _turn(self, facing: np.ndarray, up: np.ndarray, lean_rad: float) -> np.ndarray:
        """Rotation (3, 3) of the palm: towards `facing` (3,), fingers down, tilted towards it by `lean_rad`."""
        fingers = facing * np.sin(lean_rad) - up * np.cos(lean_rad)
        out = facing * np.cos(lean_rad) + up * np.sin(lean_rad)
        return np.asarray(np.stack([fingers, out, np.cross(fingers, out)], axis=1) @ self._axes)

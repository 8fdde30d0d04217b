"""Base of scripted operators: a plan is made at the start of an episode and executed to its end.

If an object is carried, the plan has a second phase, which is replanned from the grasp actually achieved.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping

import numpy as np

from dextera_build.geometry import transforms
from dextera_build.sim.control.operator import Command, NotHeld, State
from dextera_build.sim.experts.collision_check import CollisionCheck
from dextera_build.sim.experts.motion import Leg, Plan, follow
from dextera_build.sim.experts.reach import Reach
from dextera_build.sim.runtime.environment import Environment

LOST_M = 0.06
"""Distance of an object from its place in the hand beyond which the hand does not hold it [m]."""


class Scripted(ABC):
    """Executes the plan that it makes from the first state.

    Args:
        environment: The task; only its data are used.
        reach: Kinematics of its limbs.
    """

    def __init__(self, environment: Environment, reach: Reach) -> None:
        self._object, self._rate = environment.task.object, environment.task.control_hz
        self._reach = reach
        base_from_world = environment.bundle.base_pose.inverse().matrix
        self._base_from_world = base_from_world
        # The vertical in the base, (3,).
        self._up = base_from_world[:3, 2].copy()
        self._commands: Iterator[Command] = iter(())
        # The phase that is executed first.
        self._plan: Plan = {}

    def begin(self, state: State) -> None:
        """Plan from `state`."""
        phases = self.phases(state)
        self._reach.check([self._checked(plan) for plan in phases], state)
        self._plan = phases[0]
        self._commands = self._reach.some(tuple(self._plan)).commands(self._plan, state, self._rate)

    def command(self, state: State) -> Command | None:
        """The next step of the plan."""
        return next(self._commands, None)

    def phases(self, state: State) -> list[Plan]:
        """The plan from `state`, phase by phase."""
        return [{self._reach.limb: self.legs(state)}]

    def comfort(self, room: CollisionCheck, state: State) -> float | None:
        """Comfort of the arms along the plan from `state`, see `CollisionCheck.comfort`; None if it collides."""
        return room.comfort(self.phases(state), state)

    @abstractmethod
    def legs(self, state: State) -> list[Leg]:
        """The plan of one limb from `state`."""

    def _checked(self, plan: Plan) -> Plan:
        """The legs whose end poses the arms must reach."""
        return plan


class Taking(Scripted):
    """Takes the task's object; transport is replanned from the grasp actually achieved."""

    def __init__(self, environment: Environment, reach: Reach) -> None:
        super().__init__(environment, reach)
        self._start, self._goes_on = np.eye(4), False

    def begin(self, state: State) -> None:
        """Plan from `state`."""
        super().begin(state)
        self._start, self._goes_on = state.objects[self._object], False

    def command(self, state: State) -> Command | None:
        """The next step of the plan.

        Raises:
            NotHeld: The object is not in the hands that took it.
        """
        command = next(self._commands, None)
        if command is None and not self._goes_on:
            self._goes_on = True
            last = {limb: legs[-1] for limb, legs in self._plan.items()}
            self._check_lifted(state, last)
            inverse = transforms.invert(state.objects[self._object])
            held = {limb: inverse @ leg.palm for limb, leg in last.items()}
            plan = self.going_on(state, self._start, last, held)
            hands = {**self._reach.hands(state), **{limb: (leg.palm, leg.fingers) for limb, leg in last.items()}}
            self._commands = follow(plan, hands, self._rate)
            command = next(self._commands, None)
        return command

    def _check_lifted(self, state: State, last: Mapping[str, Leg]) -> None:
        """Check that the object came along with the hands."""
        for limb, held in _planned(self._plan, self._start).items():
            planned = last[limb].palm @ transforms.invert(held)
            away = float(np.linalg.norm((state.objects[self._object] - planned)[:3, 3]))
            if away > LOST_M:
                raise NotHeld(f"the grasp failed: the object is {1000 * away:.0f} mm from where the hand would hold it")

    def phases(self, state: State) -> list[Plan]:
        """The plan from `state`, with the object in the hand as planned."""
        taken, base = self.taking(state), state.objects[self._object]
        last = {limb: legs[-1] for limb, legs in taken.items()}
        return [taken, self.going_on(state, base, last, _planned(taken, base))]

    def legs(self, state: State) -> list[Leg]:
        """The first phase of one limb."""
        return list(self.taking(state)[self._reach.limb])

    @abstractmethod
    def taking(self, state: State) -> Plan:
        """The path to the object and the lift, with a segment `grasp` at whose end the object is held."""

    @abstractmethod
    def going_on(self, state: State, base: np.ndarray, last: Mapping[str, Leg], held: Mapping[str, np.ndarray]) -> Plan:
        """The second phase.

        Args:
            state: Poses of the other objects.
            base: T_base_object (4, 4) at the start.
            last: Limb -> its last leg of the first phase.
            held: Limb -> T_object_palm (4, 4) in the achieved grasp.
        """

    def _held(self, palm: np.ndarray, fingers: np.ndarray, seconds: float, name: str, frame: str | None = None) -> Leg:
        """A leg with the object in the hand, relative to the object or to another frame."""
        return Leg(palm, fingers, seconds, name, self._object if frame is None else frame, True)


def _planned(taking: Plan, base: np.ndarray) -> dict[str, np.ndarray]:
    """Limb -> T_object_palm (4, 4) as planned, of an object at `base` (4, 4) in the robot's base."""
    inverse = transforms.invert(base)
    return {
        limb: inverse @ next(leg.palm for leg in reversed(legs) if leg.segment == "grasp")
        for limb, legs in taking.items()
    }

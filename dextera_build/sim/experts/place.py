"""Scripted operator of primitive `pick_and_place`: grasp, carry over, set down, let go."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.goals import PlaceGoal
from dextera_build.artifacts.task import Cavity
from dextera_build.geometry import quaternions, transforms
from dextera_build.sim.control.operator import Command, State
from dextera_build.sim.experts.lift import Grasp
from dextera_build.sim.experts.motion import Leg, sample
from dextera_build.sim.experts.reach import Reach
from dextera_build.sim.experts.scripted import Scripted
from dextera_build.sim.runtime.environment import Environment

OVER_M = 0.08
"""Height at which the object is carried above its start and its target [m]."""
SPARE_M = 0.006
"""Height above its support at which the object is let go [m]."""
SECONDS = (0.8, 1.4, 0.9, 0.5, 0.6, 0.7)
"""Durations: lift, carry, lower, open, retreat, rest [s]."""
TAKING = ("approach", "reach", "grasp", "lift")
"""Segments before the object is carried; after them it is seen how it lies in the hand."""


class Place(Scripted):
    """Grasps the task's object, and sets it down at its target or in a container.

    Args:
        environment: The task; only its data are used.
        reach: Kinematics of a limb.
        grasp: The grasp to execute.
    """

    def __init__(self, environment: Environment, reach: Reach, grasp: Grasp) -> None:
        super().__init__(environment, reach)
        task, bundle = environment.task, environment.bundle
        assert isinstance(task.goal, PlaceGoal)
        self._goal = task.goal
        self._base_from_world = bundle.base_pose.inverse().matrix
        self._up = self._base_from_world[:3, 2].copy()
        self._points = bundle.objects[task.object].points.astype(np.float64)
        self._cavity = bundle.objects[task.goal.into].cavity if task.goal.into else None
        self.grasp = grasp
        self._start, self._carries = np.eye(4), False

    def begin(self, state: State) -> None:
        """Plan from `state`."""
        legs = self.legs(state)
        self._reach.check(legs, state)
        self._start, self._carries = state.objects[self._object], False
        taken = [leg for leg in legs if leg.segment in TAKING]
        self._last = taken[-1]
        self._commands = self._reach.commands(taken, state, self._rate)

    def command(self, state: State) -> Command | None:
        """The next step of the plan; the object is carried as it came to lie in the hand."""
        command = next(self._commands, None)
        if command is None and not self._carries:
            self._carries = True
            held = transforms.invert(state.objects[self._object]) @ self._last.palm
            legs = self._carried(state, self._start, self._last.palm, held)
            hand = self._last.palm, self._last.fingers
            self._commands = sample(self._reach.limb, *hand, legs, self._rate)
            command = next(self._commands, None)
        return command

    def legs(self, state: State) -> list[Leg]:
        """The plan from `state`, with the object in the hand as the grasp says."""
        grasp, base = self.grasp, state.objects[self._object]
        hold = base @ grasp.palm
        height = float((self._target(state, base)[:3, 3] - base[:3, 3]) @ self._up)
        raised = _shifted(hold, self._up * (max(0.0, height) + OVER_M))
        return [
            *grasp.taking(self._object, base, self._up),
            self._leg(raised, grasp.closed, SECONDS[0], "lift"),
            *self._carried(state, base, raised, grasp.palm),
        ]

    def _carried(self, state: State, base: np.ndarray, raised: np.ndarray, held: np.ndarray) -> list[Leg]:
        """The way from `raised` to the target and back from it, the palm at `held` (4, 4) in the object."""
        grasp = self.grasp
        laid = self._target(state, base) @ held
        above = _shifted(laid, self._up * float((raised[:3, 3] - laid[:3, 3]) @ self._up))
        back = _shifted(laid, base[:3, :3] @ grasp.away + self._up * 0.03)
        _, carry, lower, let, retreat, rest = SECONDS
        return [
            self._leg(above, grasp.closed, carry, "carry"),
            self._leg(laid, grasp.closed, lower, "lower"),
            self._leg(laid, grasp.open, let, "release"),
            self._leg(back, grasp.open, retreat, "retreat"),
            self._leg(back, grasp.open, rest, "retreat"),
        ]

    def _leg(self, palm: np.ndarray, fingers: np.ndarray, seconds: float, name: str) -> Leg:
        return Leg(palm, fingers, seconds, name, self._object, True)

    def _target(self, state: State, base: np.ndarray) -> np.ndarray:
        """T_base_object where it is let go, turned as it stands unless the goal says otherwise."""
        found = base.copy()
        if self._goal.quaternion is not None:
            found[:3, :3] = self._base_from_world[:3, :3] @ quaternions.to_matrix(np.array(self._goal.quaternion))
        if self._cavity is not None:
            # At the height of the rim, so that the hand stays out.
            found[:3, 3] = transforms.apply(state.objects[self._goal.into], _opening(self._cavity))
            lowest = float((self._points @ found[:3, :3].T @ self._up).min())
            found[:3, 3] += self._up * (SPARE_M - lowest)
            return found
        assert self._goal.place_m is not None
        found[:3, 3] = (self._base_from_world @ [*self._goal.place_m, 1.0])[:3] + self._up * SPARE_M
        return found


def _opening(cavity: Cavity) -> np.ndarray:
    """Middle of a cavity at the height of its rim (3,), in its frame [m]."""
    deep = cavity.rim_m - cavity.floor_m
    weights = deep / deep.sum()
    cell = np.array([float((weights * each).sum()) for each in np.indices(deep.shape)])
    return np.array([*(cavity.corner_m + (cell + 0.5) * cavity.cell_m), float(cavity.rim_m[deep > 0].max())])


def _shifted(pose: np.ndarray, way: np.ndarray) -> np.ndarray:
    moved = pose.copy()
    moved[:3, 3] += way
    return moved

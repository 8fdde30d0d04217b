"""Episodes that are made by hand, state by state, to be judged without a simulator."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from dextera_build.artifacts.tasks.task import TaskObject, TaskSpec
from dextera_build.sim.primitives.state import GraspState, TaskState
from dextera_build.sim.primitives.success import Judge
from tests import factories

PERIOD_S = 0.05
HALF_M = 0.02
"""Half edge of the box."""
ALONG = ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0))


def grasped(
    fingers: int = 0,
    opposing: bool = False,
    supported: bool = True,
    slip_m_s: float = 0.0,
    pushes: Sequence[Sequence[float]] = (),
) -> GraspState:
    """The grasp state of one hand in a single world."""
    rows = np.array(pushes, np.float64).reshape(1, -1, 3)
    # As many rows as fingers may press.
    padded = np.concatenate([rows, np.zeros((1, 3 - rows.shape[1], 3))], axis=1)
    return GraspState(np.array([fingers]), np.array([opposing]), np.array([supported]), np.array([slip_m_s]), padded)


HOLD = grasped(fingers=2, opposing=True, supported=False, pushes=ALONG)
"""A grasp that carries the object."""
SET = grasped(fingers=2, opposing=True, supported=True, pushes=ALONG)
"""The same with the object on something."""
POKE = grasped(fingers=1, supported=True, pushes=ALONG[:1])
"""A finger that presses from one side."""
AWAY = grasped(fingers=0, supported=True)
"""No contact, the object stands."""
FREE = grasped(fingers=0, supported=False)
"""No contact with anything."""


def box() -> TaskObject:
    """The object: a cube by its corners."""
    return TaskObject(
        joints=(),
        pose=factories.placed(factories.pose(z=HALF_M)),
        positions=(),
        mass_scale=(1.0, 1.0),
        friction=0.8,
        friction_sigma=0.0,
        points=factories.box_corners((-HALF_M,) * 3, (HALF_M,) * 3),
    )


class Trace:
    """Builds an episode in which a box begins on a table at the origin.

    Args:
        limbs: Hands of the robot.
        others: Other body -> T_world_body.
    """

    def __init__(self, limbs: Sequence[str] = ("right",), others: Mapping[str, np.ndarray] | None = None) -> None:
        self.limbs, self.others = limbs, dict(others or {})
        self.place, self.turn = np.array([0.0, 0.0, HALF_M]), np.eye(3)
        self.states = [self._state({})]

    def stay(self, periods: int = 1, **grasps: GraspState) -> Trace:
        """Nothing moves for some periods."""
        return self.go(self.place, periods, **grasps)

    def go(
        self, place: Iterable[float], periods: int = 20, turn: np.ndarray | None = None, **grasps: GraspState
    ) -> Trace:
        """The box moves to a place, at even speed, with these grasps; hands that are not named are away."""
        first, last = self.place, np.array(list(place), np.float64)
        for number in range(1, periods + 1):
            self.place = first + (last - first) * number / periods
            if turn is not None and number == periods:
                self.turn = turn
            self.states.append(self._state(grasps))
        return self

    def _state(self, grasps: Mapping[str, GraspState]) -> TaskState:
        free = any(not grasp.supported[0] for grasp in grasps.values())
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = self.turn, self.place
        return TaskState(
            time_s=np.array([PERIOD_S * len(getattr(self, "states", []))]),
            world_from_object=pose[None],
            others={name: each[None] for name, each in self.others.items()},
            grasps={limb: grasps.get(limb, FREE if free else AWAY) for limb in self.limbs},
        )

    def succeeds(self, task: TaskSpec, **objects: Any) -> bool:
        """Whether the episode succeeds at any time."""
        return self.verdict(task, **objects)[0]

    def verdict(self, task: TaskSpec, **objects: Any) -> tuple[bool, str]:
        """Whether the episode succeeds at any time, and what the judge says in the end."""
        done, judge = self._judged(task, **objects)
        return done, str(judge.reasons[0])

    def stage(self, task: TaskSpec, **objects: Any) -> str:
        """The last stage that was reached at any time; empty: none."""
        _, judge = self._judged(task, **objects)
        return ("", *judge.primitive.stages)[judge.stage[0]]

    def _judged(self, task: TaskSpec, **objects: Any) -> tuple[bool, Judge]:
        judge = Judge(task, self.states[0], {"box": box(), **objects}, staged=True)
        done = [bool(judge.update(state)[0]) for state in self.states[1:]]
        return any(done), judge


def about(axis: int, angle: float) -> np.ndarray:
    """Rotation (3, 3) about a coordinate axis."""
    c, s = np.cos(angle), np.sin(angle)
    one, other = [(1, 2), (2, 0), (0, 1)][axis]
    turn = np.eye(3)
    turn[one, one] = turn[other, other] = c
    turn[one, other], turn[other, one] = -s, s
    return turn

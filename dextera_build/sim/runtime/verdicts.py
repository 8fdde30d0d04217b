"""Several worlds of one task side by side, each with its own start; their episodes are judged in one call.

Physics is stepped world by world, in any order and by any thread. Then the states of all worlds become arrays with a
leading axis, which the primitive judges as it judges a single world, so that results are the same bit for bit.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence

import numpy as np

from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.policy.added import AddedTerm
from dextera_build.sim.primitives.state import stacked
from dextera_build.sim.runtime.environment import Environment, Outcome

Wanted = np.ndarray | Outcome | None
"""What is sent to a world: joint targets (A,) [rad], nothing because of the outcome of a fault, or nothing at all."""


def side_by_side(bundle: TaskBundle, count: int, terms: Sequence[AddedTerm] = ()) -> list[Environment]:
    """Environments of one task, whose model is compiled once; every one randomises its own copy.

    Args:
        bundle: The task.
        count: Number of worlds.
        terms: Terms of observations that do not come with dxb.
    """
    first = Environment(bundle, terms=terms)
    return [first, *(Environment(bundle, copy.copy(first.model), terms) for _ in range(count - 1))]


def limited(worlds: Sequence[Environment], wanted: Sequence[Wanted]) -> list[Wanted]:
    """What is sent to worlds of one task, see `Environment.limited`; an outcome if something cannot be sent."""
    found = list(wanted)
    shape, numbers = worlds[0].lower.shape, list[int]()
    for number, (world, each) in enumerate(zip(worlds, wanted, strict=True)):
        if isinstance(each, np.ndarray):
            if each.shape == shape and np.isfinite(each).all():
                numbers.append(number)
            else:
                found[number] = world.broken(each)
    if numbers:
        actions = np.array([wanted[number] for number in numbers], np.float64)
        before = np.array([worlds[number].previous_action for number in numbers])
        for number, target in zip(numbers, worlds[0].within(actions, before), strict=True):
            found[number] = target
    return found


class Verdicts:
    """Ends the control periods of several worlds of one task together.

    One judge follows all episodes, unless goals or sizes that matter are drawn; then every world keeps its own. With
    one judge, `judge` and `now` of an environment are those at the start of its episode.

    Args:
        worlds: The worlds, each at the start of an episode.
    """

    def __init__(self, worlds: Sequence[Environment]) -> None:
        self._worlds = tuple(worlds)
        first = self._worlds[0]
        self.now = stacked([world.now for world in worlds])
        """States that were judged last (N)."""
        self.judge = None if len(worlds) == 1 or _differ(first) else first.judge_of(self.now)
        """Follows all episodes; None: every world has its own."""

    def begin(self, numbers: Sequence[int]) -> None:
        """Take over the starts of worlds that began an episode."""
        if self.judge is not None and numbers:
            begun = np.zeros(len(self._worlds), bool)
            begun[list(numbers)] = True
            self.judge.begin(begun, stacked([world.now for world in self._worlds]))

    def conclude(self, sent: Sequence[np.ndarray | None]) -> list[Outcome | None]:
        """End a control period.

        Args:
            sent: Targets (A,) [rad] of every world, whose physics has been stepped; None: it stands still.

        Returns:
            The outcome in every world; None where it stands still.
        """
        pairs = list(zip(self._worlds, sent, strict=True))
        if self.judge is None:
            return [None if target is None else world.conclude(target) for world, target in pairs]
        for world, target in pairs:
            if target is not None:
                world.count(target)
        moved = np.array([target is not None for target in sent])
        self.now = stacked([world.state() for world in self._worlds])
        done = self.judge.update(self.now, None if moved.all() else moved).tolist()
        return [
            None if target is None else world.result(target, self.judge, done[number], number)
            for number, (world, target) in enumerate(pairs)
        ]


def _differ(world: Environment) -> bool:
    """Whether worlds differ in what a judge is made of."""
    bundle, reset = world.bundle, world.bundle.task.reset
    sized = bundle.kind == "twin" and reset.dynamics and any(each.scale_sigma for each in bundle.objects.values())
    return bool(reset.goal_m or reset.goal_rad or (sized and world.primitive.shaped))

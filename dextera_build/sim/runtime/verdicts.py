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
from dextera_build.sim.primitives.success import Judge
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

    One judge follows the episodes of all worlds, except of those whose start has a goal of its own, or sizes that
    matter to it; they keep their own judge. With the common one, `judge` and `now` of an environment are those at its
    start.

    Args:
        worlds: The worlds, each at the start of an episode.
    """

    def __init__(self, worlds: Sequence[Environment]) -> None:
        self._worlds = tuple(worlds)
        first = self._worlds[0]
        self.now = stacked([world.now for world in worlds])
        """States that were judged last (N)."""
        self.judge = Judge(first.bundle.task, self.now, first.bundle.objects, staged=first.staged)
        """Follows the episodes of all worlds but `own`."""
        self.own = {number for number, world in enumerate(worlds) if len(worlds) == 1 or _own(world)}
        """Numbers of the worlds that have their own judge."""

    def begin(self, numbers: Sequence[int]) -> None:
        """Take over the starts of worlds that began an episode."""
        if len(self._worlds) == 1 or not numbers:
            return
        self.own -= set(numbers)
        self.own |= {number for number in numbers if _own(self._worlds[number])}
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
        found: list[Outcome | None] = [None] * len(sent)
        together = []
        for number, (world, target) in enumerate(zip(self._worlds, sent, strict=True)):
            if target is not None and number in self.own:
                found[number] = world.conclude(target)
            elif target is not None:
                world.count(target)
                together.append(number)
        if together:
            done = self._together(together).tolist()
            for number in together:
                world, target = self._worlds[number], sent[number]
                assert target is not None
                found[number] = world.result(target, self.judge, done[number], number)
        return found

    def _together(self, numbers: Sequence[int]) -> np.ndarray:
        """Verdicts (N,) of the common judge, of which those of the worlds that moved count."""
        pairs = enumerate(self._worlds)
        self.now = stacked([world.now if number in self.own else world.state() for number, world in pairs])
        moved = np.zeros(len(self._worlds), bool)
        moved[list(numbers)] = True
        return self.judge.update(self.now, None if moved.all() else moved)


def _own(world: Environment) -> bool:
    """Whether the start of a world differs from others in what a judge is made of."""
    start, task = world.start, world.bundle.task
    goal = start.variation.goal
    sized = world.primitive.shaped and any(size != 1.0 for size in start.size_scale.values())
    return sized or (goal is not None and goal != task.goal)

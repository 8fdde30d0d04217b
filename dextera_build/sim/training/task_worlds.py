"""Several worlds of a task in one process: stepped by threads, then judged, valued and observed in one call for all.

Every world gives bit for bit what a `TaskEnv` of its own would give, whatever the number of threads. `mujoco.rollout`
would step them in one call, but it returns neither the warm start of the solver nor the sleeping bodies, so that
results would depend on the distribution of worlds over its threads.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.policy.added import AddedTerm
from dextera_build.policy.observation import Measurement, in_worlds
from dextera_build.policy.terms import Term
from dextera_build.sim.observe import progress
from dextera_build.sim.runtime import privileged
from dextera_build.sim.runtime.environment import Outcome
from dextera_build.sim.runtime.verdicts import Verdicts, Wanted, limited, side_by_side
from dextera_build.sim.training.gym import TaskEnv, opened
from dextera_build.sim.training.threads import Threads

T = TypeVar("T")
Observations = dict[str, np.ndarray]


@dataclass(frozen=True)
class Steps:
    """One step of every world."""

    rewards: np.ndarray
    """Change of the value (N,) float64; 0 in a world that stood still."""
    ended: np.ndarray
    """Whether success or a fault ended the episode (N,) bool."""
    late: np.ndarray
    """Whether the time limit ended it (N,) bool."""
    faults: tuple[int, ...]
    """Worlds that a fault ended; they are observed as they were before."""


class TaskWorlds:
    """N worlds of one task.

    Args:
        bundle: The task, or the path of an exported one.
        count: N.
        threads: Threads that step them; None: one per core.
        terms: Terms of observations that do not come with dxb.
        options: Options of `TaskEnv`, the same for every world.
    """

    def __init__(
        self,
        bundle: TaskBundle | str | Path,
        count: int,
        *,
        threads: int | None = None,
        terms: Sequence[AddedTerm] = (),
        **options: Any,
    ) -> None:
        self.environments = side_by_side(opened(bundle), count, terms)
        self.tasks = [TaskEnv(world, **options) for world in self.environments]
        self.terms = self.tasks[0].terms
        """Observed terms, in the order of the observation."""
        # Pictures need GL contexts, which belong to the thread that created them.
        drawn = any(term.camera for term in self.terms)
        self._threads = Threads(1 if drawn else threads, count)
        self._verdicts = Verdicts(self.environments)
        hidden = any(term.declared.seen_by == "critics" for term in self.terms)
        self._simulated = privileged.Simulated(self.environments) if hidden else None
        self._last: Observations = {}

    def begin(self, numbers: Sequence[int], begun: Callable[[int], None]) -> None:
        """Begin episodes in some worlds, `begun(number)` in each, which calls `TaskEnv.begin`."""
        self._threads.each(lambda each: begun(numbers[each]), len(numbers))
        self._verdicts.begin(numbers)

    def each(self, work: Callable[[int], T]) -> list[T]:
        """The results of a function of the number of a world, called in threads."""
        return self._threads.each(work, len(self.tasks))

    def advance(self, wanted: Sequence[Wanted]) -> list[Outcome | None]:
        """Simulate one control period.

        Args:
            wanted: What is sent to every world.

        Returns:
            The outcome in every world; None where nothing was wanted.
        """
        sent = limited(self.environments, wanted)

        def step(number: int) -> None:
            target = sent[number]
            if isinstance(target, np.ndarray):
                self.environments[number].advance(target)

        self.each(step)
        concluded = self._verdicts.conclude([each if isinstance(each, np.ndarray) else None for each in sent])
        return [each if isinstance(each, Outcome) else done for each, done in zip(sent, concluded, strict=True)]

    def steps(self, outcomes: Sequence[Outcome | None]) -> Steps:
        """The rewards of control periods that ended with these outcomes, one per world; None: it stood still."""
        success = np.array([outcome is not None and outcome.success for outcome in outcomes])
        values = self._values(success)
        rewards, ended, late, faults = np.zeros(len(outcomes)), success.copy(), np.zeros(len(outcomes), bool), []
        for number, (task, outcome) in enumerate(zip(self.tasks, outcomes, strict=True)):
            if outcome is None:
                continue
            late[number], fault = task.ended(outcome)
            if fault:
                ended[number] = True
                faults.append(number)
            else:
                rewards[number] = task.earned(float(values[number]))
        return Steps(rewards, ended, late, tuple(faults))

    def observe(self, faults: Iterable[int] = ()) -> Observations:
        """Key of a term -> its values in all worlds (N, ...); as they were before where a fault ended the episode."""
        worlds = self.environments
        measured = [task.measured() for task in self.tasks]
        shown = in_worlds(
            measured,
            [world.previous_action for world in worlds],
            [world.goal for world in worlds],
            worlds[0].added,
        )
        if self._simulated is not None:
            shown |= privileged.values(self._simulated)
        found = {term.key: _picked(term, shown, measured) for term in self.terms}
        for number in faults:
            for key, values in found.items():
                values[number] = self._last[key][number]
        self._last = found
        return found

    def close(self) -> None:
        """Free threads and renderers."""
        self._threads.close()
        for task in self.tasks:
            task.close()

    def _values(self, success: np.ndarray) -> np.ndarray:
        """Values of the current states (N,)."""
        verdicts, parts = self._verdicts, [task.progress for task in self.tasks]
        found = np.zeros(len(parts))
        if len(verdicts.own) < len(parts):
            found = progress.values(parts, verdicts.judge, success, verdicts.now)
        for number in verdicts.own:
            found[number] = parts[number].value(bool(success[number]), self.environments[number].now)
        return found


def _picked(term: Term, shown: Observations, measured: Sequence[Measurement]) -> np.ndarray:
    name = term.declared.name
    if term.camera:
        return np.stack([getattr(each.frames[term.camera], name) for each in measured])
    return shown[name]

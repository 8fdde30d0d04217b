"""Worlds of a task in which a reinforcement-learned policy practises, with decisions and normalised observations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dextera_build.artifacts.tasks.policy import PolicyContract
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.policy import contract as contracts
from dextera_build.policy.added import AddedTerm
from dextera_build.policy.features import Fields, Reader
from dextera_build.policy.layout import of_bundle
from dextera_build.sim.control.steering import Steering
from dextera_build.sim.model.model import untextured
from dextera_build.sim.runtime.drawable import drawable
from dextera_build.sim.runtime.environment import Outcome
from dextera_build.sim.runtime.seeds import seed_of
from dextera_build.sim.training.gym import DEPLOYABLE, PRIVILEGED
from dextera_build.sim.training.insight import insight
from dextera_build.sim.training.task_worlds import Observations, Steps, TaskWorlds


@dataclass(frozen=True)
class Place:
    """State of one world."""

    episode: int = -1
    """Number of its episode."""
    share: float = 1.0
    """Fraction of the task's ranges from which its start was drawn."""
    decisions: tuple[np.ndarray, ...] = ()
    """Decisions (M,) since its start."""


@dataclass(frozen=True)
class Decided:
    """One decision in every world."""

    numbers: np.ndarray
    """Observations (N, K + P) float32."""
    steps: Steps
    """Rewards, and which episodes ended."""
    success: np.ndarray
    """Whether the task is done (N,) bool."""


class Practices:
    """Observations (N, K + P) float32: K deployable numbers, then P privileged ones for the critic or for a teacher.

    The seed of episode k of a world is derived from `seed`, the number of the world and k, so results depend neither on
    the number of threads nor on the number of worlds beside it. If its start cannot be drawn, the first seed after it
    whose start can be drawn takes its place.

    Args:
        bundle: The task.
        contract: Inputs and outputs of the policy.
        count: N, the number of worlds.
        seed: Seed of the training.
        threads: Threads that step the worlds.
        terms: Terms of observations that do not come with dxb.
    """

    def __init__(
        self,
        bundle: TaskBundle,
        contract: PolicyContract,
        count: int = 1,
        seed: int = 0,
        *,
        threads: int = 1,
        terms: Sequence[AddedTerm] = (),
    ) -> None:
        # Nothing is rendered, and textures are most of a model.
        plain = bundle.model_copy(update={"model": untextured(bundle.model)})
        self.worlds = TaskWorlds(plain, count, threads=threads, terms=terms, privileged=True, action="joint")
        self._reader = Reader(contract.inputs, of_bundle(bundle, terms=self.worlds.environments[0].specs))
        # One for all worlds, because it keeps nothing between decisions.
        self._steering = Steering(bundle.robot, contract)
        self._seed = seed
        self.places = [Place()] * count
        """The state of every world."""
        self.share = 1.0
        """Fraction of the task's ranges from which starts are drawn."""
        self.replaced: list[tuple[int, int]] = []
        """(world, episode) whose start was drawn with another seed."""
        self._inputs: Fields = {}
        self.seen: Observations = {}
        """The observation from which `numbers` were made last."""
        self.size = self._observed(()).shape[1]
        """K + P."""
        teaches = contract.settings.get(contracts.PRIVILEGED, 0)
        self.public = self._steering.numbers(self._inputs).shape[1] + int(teaches)
        """Number of the first numbers of an observation that the policy sees."""
        self.decisions = self._steering.size
        """Size of a decision."""
        self.every = self._steering.every
        """Control periods of a decision."""

    def reset(self, numbers: Sequence[int] | None = None) -> np.ndarray:
        """Begin the next episode in these worlds, None: in all; the observations of all worlds (N, K + P)."""
        chosen = range(len(self.places)) if numbers is None else numbers
        for number in chosen:
            self.places[number] = Place(self.places[number].episode + 1, self.share)
        self.worlds.begin(chosen, self._begin)
        return self._observed(())

    def step(self, decisions: Sequence[np.ndarray | None]) -> Decided:
        """Execute one decision (M,) in every world; None: the world stands still."""
        goals: list[np.ndarray | None] = []
        for number, decision in enumerate(decisions):
            if decision is None:
                goals.append(None)
                continue
            place = self.places[number]
            self.places[number] = replace(place, decisions=(*place.decisions, np.array(decision, np.float32)))
            inputs = {name: part[number : number + 1] for name, part in self._inputs.items()}
            goals.append(self._steering.steered(decision, inputs))
        outcomes = self._carried_out(goals)
        steps = self.worlds.steps(outcomes)
        success = np.array([outcome is not None and outcome.success for outcome in outcomes])
        return Decided(self._observed(steps.faults), steps, success)

    def go_to(self, places: Sequence[Place]) -> np.ndarray:
        """Restore the worlds after these decisions of their episodes, exactly; the observations (N, K + P)."""
        self.places = [replace(place, decisions=()) for place in places]
        self.worlds.begin(range(len(places)), self._begin)
        numbers, made = self._observed(()), [place.decisions for place in places]
        for step in range(max(map(len, made))):
            numbers = self.step([each[step] if step < len(each) else None for each in made]).numbers
        return numbers

    def close(self) -> None:
        """Free the threads."""
        self.worlds.close()

    def _begin(self, number: int) -> None:
        place, first = self.places[number], seed_of(self._seed, number, self.places[number].episode)

        def begin(seed: int) -> int:
            self.worlds.tasks[number].begin(seed, {"share": place.share})
            return seed

        if drawable(begin, first) != first:
            self.replaced.append((number, place.episode))

    def _carried_out(self, goals: Sequence[np.ndarray | None]) -> list[Outcome | None]:
        """Send targets (T, A) for T control periods, until an episode is over."""
        outcomes: list[Outcome | None] = [None] * len(goals)
        for period in range(self.every):
            wanted = [
                None if goal is None or (last is not None and last.over) else goal[period]
                for goal, last in zip(goals, outcomes, strict=True)
            ]
            found = self.worlds.advance(wanted)
            outcomes = [new or last for new, last in zip(found, outcomes, strict=True)]
        return outcomes

    def _observed(self, faults: Sequence[int]) -> np.ndarray:
        self.seen = self.worlds.observe(faults)
        return self._numbers()

    def _numbers(self) -> np.ndarray:
        prefix, hidden, seen = f"{DEPLOYABLE}/", f"{PRIVILEGED}/", self.seen
        fields = {name.removeprefix(prefix): part for name, part in seen.items() if name.startswith(prefix)}
        self._inputs = self._reader.read(fields)
        known = {name.removeprefix(hidden): part for name, part in seen.items() if name.startswith(hidden)}
        values = [task.value for task in self.worlds.tasks]
        more = insight(self.worlds.environments, self._steering.limbs, known, values)
        return np.concatenate([self._steering.numbers(self._inputs), more], axis=1)

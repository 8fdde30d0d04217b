"""A task as training environment of a reinforcement-learned policy, with decisions and normalised observations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from dextera_build.artifacts.tasks.policy import PolicyContract
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.policy import contract as contracts
from dextera_build.policy.added import AddedTerm
from dextera_build.policy.features import Fields, Reader
from dextera_build.policy.layout import of_bundle
from dextera_build.sim.control.steering import Steering
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.seeds import seed_of
from dextera_build.sim.training.gym import DEPLOYABLE, PRIVILEGED, TaskEnv
from dextera_build.sim.training.insight import insight


class Practice(gymnasium.Env[np.ndarray, np.ndarray]):
    """Observations (N + P,) float32: N deployable numbers, then P privileged ones for the critic or for a teacher.

    The seed of episode k is derived from `seed`, `number` and k, so results do not depend on the order in which several
    environments are stepped.

    Args:
        bundle: The task.
        contract: Inputs and outputs of the policy.
        seed: Seed of the training.
        number: Index of this environment among several.
        terms: Terms of observations that do not come with dxb.
    """

    def __init__(
        self,
        bundle: TaskBundle,
        contract: PolicyContract,
        seed: int = 0,
        number: int = 0,
        terms: Sequence[AddedTerm] = (),
    ) -> None:
        environment = Environment(bundle, terms=terms)
        self._task = TaskEnv(environment, privileged=True, action="joint")
        self._reader = Reader(contract.inputs, of_bundle(bundle, terms=environment.specs))
        self._steering = Steering(bundle.robot, contract)
        self._seed, self._number = seed, number
        self.episode = -1
        self.decisions: list[np.ndarray] = []
        self._inputs: Fields = {}
        self.seen = self._begin(0)
        self.observation_space = spaces.Box(-np.inf, np.inf, self._observation().shape, np.float32)
        teaches = contract.settings.get(contracts.PRIVILEGED, 0)
        self.public = self._steering.numbers(self._inputs).shape[1] + int(teaches)
        """Number of the first numbers of an observation that the policy sees."""
        self.action_space = spaces.Box(-1.0, 1.0, (self._steering.size,), np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin the next episode, or the first of another seed."""
        super().reset(seed=seed)
        if seed is not None:
            self._seed, self.episode = seed, -1
        self.episode += 1
        self.decisions = []
        self.seen = self._begin(self.episode)
        return self._observation(), {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Execute one decision (M,)."""
        self.decisions.append(np.array(action, np.float32))
        for target in self._steering.steered(action, self._inputs):
            outcome = self._task.environment.step(target)
            if outcome.over:
                break
        self.seen, earned, ended, late, info = self._task.conclude(outcome)
        return self._observation(), earned, ended, late, info

    def go_to(self, episode: int, decisions: list[np.ndarray]) -> np.ndarray:
        """Restore the state after these decisions of an episode, exactly."""
        self.episode = episode - 1
        observation, _ = self.reset()
        for decision in decisions:
            observation, *_ = self.step(decision)
        return observation

    def _begin(self, episode: int) -> Fields:
        return self._task.reset(seed=seed_of(self._seed, self._number, episode))[0]

    def _observation(self) -> np.ndarray:
        prefix = f"{DEPLOYABLE}/"
        fields = {name.removeprefix(prefix): part[None] for name, part in self.seen.items() if name.startswith(prefix)}
        self._inputs = self._reader.read(fields)
        hidden = f"{PRIVILEGED}/"
        known = {name.removeprefix(hidden): part for name, part in self.seen.items() if name.startswith(hidden)}
        more = insight(self._task.environment, self._steering.limb, known, self._task.value)
        return np.concatenate([self._steering.numbers(self._inputs)[0], more])

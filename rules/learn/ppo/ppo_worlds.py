"""Several environments on one core, because other nodes of a build use the others."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from stable_baselines3.common.vec_env import DummyVecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn

from dextera_build.artifacts.tasks.policy import PolicyContract
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.policy.added import AddedTerm
from dextera_build.sim.training.practice import Practice

Place = tuple[int, list[np.ndarray]]
"""State of one environment: number of its episode, decisions since its start."""


class Worlds(DummyVecEnv):
    """Environments whose state can be restored from an interrupted training.

    Args:
        bundle: The task.
        contract: Inputs and outputs of the policy.
        count: Number of environments.
        seed: Seed of the starts.
        terms: Terms of observations that do not come with dxb.
    """

    def __init__(
        self, bundle: TaskBundle, contract: PolicyContract, count: int, seed: int, terms: Sequence[AddedTerm] = ()
    ) -> None:
        self.practices = [Practice(bundle, contract, seed, number, terms) for number in range(count)]
        super().__init__([lambda practice=practice: practice for practice in self.practices])  # type: ignore[misc]
        self.public = self.practices[0].public

    def step_wait(self) -> VecEnvStepReturn:
        """Step all environments, and reset those whose episode ended."""
        results = [_step(*pair) for pair in zip(self.practices, self.actions, strict=True)]
        for number, (observation, reward, done, info) in enumerate(results):
            self._save_obs(number, observation)
            self.buf_rews[number], self.buf_dones[number], self.buf_infos[number] = reward, done, info
        return self._obs_from_buf(), np.copy(self.buf_rews), np.copy(self.buf_dones), list(self.buf_infos)

    def places(self) -> list[Place]:
        """The state of every environment."""
        return [(practice.episode, list(practice.decisions)) for practice in self.practices]

    def go_to(self, places: Sequence[Place]) -> np.ndarray:
        """Restore the states `places`; return the observations (W, N + P)."""
        return np.stack([practice.go_to(*place) for practice, place in zip(self.practices, places, strict=True)])


def _step(practice: Practice, decision: np.ndarray) -> tuple[np.ndarray, float, bool, dict[str, Any]]:
    observation, reward, ended, late, info = practice.step(decision)
    info["TimeLimit.truncated"] = late and not ended
    if ended or late:
        info["terminal_observation"] = observation
        observation, _ = practice.reset()
    return observation, reward, ended or late, info

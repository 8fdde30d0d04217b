"""A task as training environment of a reinforcement-learned policy, with decisions and normalised observations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from dextera_build.artifacts.tasks.policy import PolicyContract
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.policy.added import AddedTerm
from dextera_build.policy.features import Fields, Reader
from dextera_build.policy.layout import of_bundle
from dextera_build.sim.control.steering import Steering
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.seeds import seed_of
from dextera_build.sim.training.gym import DEPLOYABLE, PRIVILEGED, TaskEnv

FORCE_N, PLACE_M = 5.0, 0.3
"""Scales of privileged forces [N] and positions relative to the palm [m]."""


class Practice(gymnasium.Env[np.ndarray, np.ndarray]):
    """Observations (N + P,) float32: the policy's N numbers, then P privileged ones for its critic.

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
        self.public = self._steering.numbers(self._inputs).shape[1]
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
        return np.concatenate([self._steering.numbers(self._inputs)[0], self._insight()])

    def _insight(self) -> np.ndarray:
        """Privileged numbers (P,): forces, velocities, fingertips and object surface from their palms, time."""
        environment = self._task.environment
        robot, hands = environment.bundle.robot, self.seen[f"{PRIVILEGED}/hand_poses"]
        hand = hands[robot.limb_names.index(self._steering.limb)]
        own = [number for number, name in enumerate(robot.limb_names) for _ in robot.limbs[name].tips]
        parts = [
            np.tanh(self.seen.get(f"{PRIVILEGED}/contact", np.zeros(0)) / FORCE_N),
            self.seen[f"{PRIVILEGED}/joint_velocities"],
            self.seen[f"{PRIVILEGED}/object_velocities"],
            (self.seen.get(f"{PRIVILEGED}/tip_poses", np.zeros((0, 7)))[:, :3] - hands[own, :3]) / PLACE_M,
            (self.seen[f"{PRIVILEGED}/points"].mean(axis=0) - hand[:3]) / PLACE_M,
            [environment.steps * environment.period_s / environment.task.timeout_s, self._task.value],
        ]
        numbers = np.concatenate([np.ravel(part) for part in parts])
        return np.asarray(np.clip(numbers, -5.0, 5.0), np.float32)

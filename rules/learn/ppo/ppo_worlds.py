"""The worlds of a training as stable-baselines3 takes them."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn

from dextera_build.sim.training.practice import Practices


class Worlds(VecEnv):
    """Worlds whose state can be restored from an interrupted training.

    Args:
        practices: The worlds.
    """

    def __init__(self, practices: Practices) -> None:
        self.practices, self.render_mode = practices, None
        self.public = practices.public
        seen = spaces.Box(-np.inf, np.inf, (practices.size,), np.float32)
        super().__init__(len(practices.places), seen, spaces.Box(-1.0, 1.0, (practices.decisions,), np.float32))

    def reset(self) -> np.ndarray:
        """Begin an episode in every world; the observations (N, K)."""
        return self.practices.reset()

    def step_async(self, actions: np.ndarray) -> None:
        """Take one decision (N, M) for every world."""
        self._decisions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Step all worlds, and begin the next episode where one ended."""
        found = self.practices.step(list(self._decisions))
        steps, seen = found.steps, found.numbers
        done = steps.ended | steps.late
        infos: list[dict[str, Any]] = [
            {"is_success": success, "TimeLimit.truncated": late}
            for success, late in zip(found.success.tolist(), (steps.late & ~steps.ended).tolist(), strict=True)
        ]
        if done.any():
            numbers = np.flatnonzero(done).tolist()
            for number in numbers:
                infos[number]["terminal_observation"] = seen[number].copy()
            seen = self.practices.reset(numbers)
        return seen, steps.rewards.astype(np.float32), done, infos

    def close(self) -> None:
        """Free the threads."""
        self.practices.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute of the worlds, which have it in common."""
        return [getattr(self, attr_name)] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Not possible: no world has attributes of its own."""
        raise AttributeError(attr_name)

    def env_method(self, method_name: str, *arguments: Any, indices: Any = None, **named: Any) -> list[Any]:
        """Not possible: no world has methods of its own."""
        raise AttributeError(method_name)

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """No world is wrapped."""
        return [False] * self.num_envs

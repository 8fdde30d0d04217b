"""Several copies of a task in one process, stepped by threads.

MuJoCo releases the interpreter's lock, so the physics of the copies runs in parallel; every copy is a `TaskEnv` and
steps exactly as a single one. `mujoco.rollout` would step them in one call, but it returns neither the warm start of
the solver nor the sleeping bodies, so that results would depend on the distribution of copies over its threads.
"""

from __future__ import annotations

import copy
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space, concatenate, create_empty_array

from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.policy.added import AddedTerm
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.training.gym import TaskEnv, opened

Observations = dict[str, np.ndarray]


class TaskVectorEnv(VectorEnv[Observations, np.ndarray, np.ndarray]):
    """`num_envs` copies of one task. Autoreset mode `NEXT_STEP`: the step after termination ignores its action.

    Args:
        bundle: The task, or the path of an exported one.
        num_envs: Number of copies.
        threads: Threads that step them; None: one per core, at most one per copy.
        terms: Terms of observations that do not come with dxb.
        options: Options of `TaskEnv`, the same for every copy.
    """

    def __init__(
        self,
        bundle: TaskBundle | str | Path,
        num_envs: int = 1,
        *,
        threads: int | None = None,
        terms: Sequence[AddedTerm] = (),
        **options: Any,
    ) -> None:
        task = opened(bundle)
        first = TaskEnv(Environment(task, terms=terms), **options)
        # The model is compiled once; every copy randomises its own.
        worlds = (Environment(task, copy.copy(first.environment.model), terms) for _ in range(num_envs - 1))
        copies = (TaskEnv(world, **options) for world in worlds)
        self.copies = [first, *copies]
        self.num_envs = num_envs
        self.metadata = {**first.metadata, "autoreset_mode": AutoresetMode.NEXT_STEP}
        self.render_mode = first.render_mode
        self.single_observation_space, self.single_action_space = first.observation_space, first.action_space
        self.observation_space = batch_space(first.observation_space, num_envs)
        self.action_space = batch_space(first.action_space, num_envs)
        # Pictures need GL contexts, which belong to the thread that created them.
        drawn = any(term.camera for term in first.terms)
        count = 1 if drawn else min(num_envs, threads or os.cpu_count() or 1)
        self._pool = ThreadPoolExecutor(count) if count > 1 else None
        self._over = np.zeros(num_envs, bool)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, Any]]:
        """Begin an episode in every copy; copy k of an integer `seed` gets `seed + k`."""
        super().reset(seed=seed if isinstance(seed, int) else None)
        seeds = (
            [None if seed is None else seed + number for number in range(self.num_envs)]
            if (seed is None or isinstance(seed, int))
            else seed
        )
        self._over[:] = False
        found = self._each(lambda number: self.copies[number].reset(seed=seeds[number], options=options))
        return self._gathered([seen for seen, _ in found]), self._infos([info for _, info in found])

    def step(self, actions: np.ndarray) -> tuple[Observations, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Send actions (N, ...), one per copy, for one control period; rewards, terminated and truncated are (N,)."""
        found = self._each(lambda number: self._step(number, actions[number]))
        seen, rewards, terminated, truncated, infos = zip(*found, strict=True)
        ended, late = np.array(terminated, bool), np.array(truncated, bool)
        self._over = ended | late
        return self._gathered(list(seen)), np.array(rewards, np.float64), ended, late, self._infos(list(infos))

    def close_extras(self, **_: Any) -> None:
        """Free threads and renderers."""
        if self._pool is not None:
            self._pool.shutdown()
        for each in self.copies:
            each.close()

    def render(self) -> tuple[Any, ...] | None:
        """The picture of every copy, see `TaskEnv.render`; None without a render mode."""
        return None if self.render_mode is None else tuple(each.render() for each in self.copies)

    def _step(self, number: int, action: np.ndarray) -> tuple[Observations, float, bool, bool, dict[str, Any]]:
        if self._over[number]:
            seen, info = self.copies[number].reset()
            return seen, 0.0, False, False, info
        return self.copies[number].step(action)

    def _each(self, work: Callable[[int], Any]) -> list[Any]:
        return list((self._pool.map if self._pool else map)(work, range(self.num_envs)))

    def _gathered(self, seen: list[Observations]) -> Observations:
        space = self.single_observation_space
        out: Any = create_empty_array(space, self.num_envs)
        found: Any = concatenate(space, seen, out)
        return dict(found)

    def _infos(self, infos: list[dict[str, Any]]) -> dict[str, Any]:
        gathered: dict[str, Any] = {}
        for number, info in enumerate(infos):
            gathered = self._add_info(gathered, info, number)
        return gathered

"""Several copies of a task as one environment of Gymnasium, see `TaskWorlds`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.policy.added import AddedTerm
from dextera_build.sim.runtime.environment import Outcome
from dextera_build.sim.runtime.verdicts import Wanted
from dextera_build.sim.training.task_worlds import Observations, TaskWorlds


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
        self.worlds = TaskWorlds(bundle, num_envs, threads=threads, terms=terms, **options)
        first = self.worlds.tasks[0]
        self.num_envs = num_envs
        self.metadata = {**first.metadata, "autoreset_mode": AutoresetMode.NEXT_STEP}
        self.render_mode = first.render_mode
        self.single_observation_space, self.single_action_space = first.observation_space, first.action_space
        self.observation_space = batch_space(first.observation_space, num_envs)
        self.action_space = batch_space(first.action_space, num_envs)
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
        tasks = self.worlds.tasks
        self.worlds.begin(range(self.num_envs), lambda number: tasks[number].begin(seeds[number], options))
        return self.worlds.observe(), self._infos([None] * self.num_envs)

    def step(self, actions: np.ndarray) -> tuple[Observations, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Send actions (N, ...), one per copy, for one control period; rewards, terminated and truncated are (N,)."""
        tasks = self.worlds.tasks
        outcomes = self.worlds.advance(self._wanted(actions))
        steps = self.worlds.steps(outcomes)
        begun = np.flatnonzero(self._over).tolist()
        self.worlds.begin(begun, lambda number: tasks[number].begin())
        self._over = steps.ended | steps.late
        seen = self.worlds.observe(steps.faults)
        return seen, steps.rewards, steps.ended, steps.late, self._infos(outcomes)

    def close_extras(self, **_: Any) -> None:
        """Free threads and renderers."""
        self.worlds.close()

    def render(self) -> tuple[Any, ...] | None:
        """The picture of every copy, see `TaskEnv.render`; None without a render mode."""
        return None if self.render_mode is None else tuple(each.render() for each in self.worlds.tasks)

    def _wanted(self, actions: np.ndarray) -> list[Wanted]:
        """What is sent to every copy; nothing where an episode is over."""
        tasks, over = self.worlds.tasks, self._over.tolist()
        spec = tasks[0].actions.spec
        if spec.kind != "joint":
            return self.worlds.each(lambda number: None if over[number] else tasks[number].targets(actions[number]))
        clipped = np.minimum(np.maximum(np.asarray(actions, np.float64), spec.lower), spec.upper)
        fine = np.isfinite(clipped).all(axis=1).tolist()
        return [
            None if over[number] else clipped[number] if fine[number] else tasks[number].targets(actions[number])
            for number in range(self.num_envs)
        ]

    def _infos(self, outcomes: Sequence[Outcome | None]) -> dict[str, Any]:
        """The facts of `TaskEnv` in all copies, and as in every vector environment whether a copy has them."""
        success = np.array([outcome is not None and outcome.success for outcome in outcomes])
        worlds = zip(self.worlds.environments, outcomes, strict=True)
        found: dict[str, Any] = {
            "is_success": success,
            "success": success.copy(),
            "reason": np.array([outcome.reason if outcome else "" for outcome in outcomes], object),
            "executed": np.stack([outcome.executed if outcome else world.previous_action for world, outcome in worlds]),
        }
        return found | {f"_{name}": np.ones(self.num_envs, bool) for name in found}

"""Trials: results of one policy, or of replayed demonstrations, in one task of one world."""

from __future__ import annotations

from collections import Counter
from typing import Annotated, ClassVar, Literal

import numpy as np

from dextera_build.artifacts import former
from dextera_build.artifacts.base import Array, Artifact, Value
from dextera_build.artifacts.episode import Episodes
from dextera_build.artifacts.task import TaskSpec, WorldKind

Actor = Literal["policy", "replay"]
"""`policy`: closed loop. `replay`: joint targets that succeeded in the twin, sent open loop."""


class Trial(Value):
    """One attempt from one start."""

    seed: int
    """Seed of the start; the same seed means the same start for every policy in a world."""
    start: str
    """Digest of the start: positions, joint targets and dynamics."""
    success: bool
    """Verdict of the task's success predicate."""
    reason: str
    """Why it failed; empty for a success."""
    steps: int
    """Control periods until it ended."""


class Trials(Artifact):
    """Trials of one actor in one task of one world. Equal seeds give equal starts."""

    type_version: ClassVar[int] = 2
    readers: ClassVar[former.Readers] = {1: former.unchanged}

    actor: Actor
    """Source of the actions."""
    label: str
    """Its name in tables: `ACT`, `PPO`, `replay`."""
    algorithm: str
    """Training algorithm of the policy, `act` or `ppo`; empty for a replay."""
    source: str
    """Digest of the checkpoint, or of the demonstrations that were replayed."""
    task: TaskSpec
    """The objective and its success criterion."""
    embodiment: str
    """Digest of joint names and limits."""
    robot: str
    """Name of the robot's model."""
    world: WorldKind
    """Kind of world; none is real."""
    items: tuple[Trial, ...]
    """Valid attempts, in order."""
    placed: Annotated[np.ndarray, Array("N O 7", "float32", frame="base")]
    """Poses of the bundle's objects at the start of each attempt: position [m], unit quaternion w x y z."""
    excluded: dict[str, int]
    """Reason -> seeds without an attempt: no start without collisions, no rollout that succeeds in the twin."""
    examples: Episodes
    """The first success and the first failure, by their number in `items`."""

    @property
    def successes(self) -> int:
        """Number of attempts that succeeded."""
        return sum(trial.success for trial in self.items)

    @property
    def reasons(self) -> dict[str, int]:
        """Reason of failure -> count, most frequent first."""
        return dict(Counter(trial.reason for trial in self.items if not trial.success).most_common())

    @property
    def mean_time_s(self) -> float | None:
        """Mean time of the successes until the verdict [s], including the hold time; None without successes."""
        steps = [trial.steps for trial in self.items if trial.success]
        return float(np.mean(steps)) / self.task.control_hz if steps else None

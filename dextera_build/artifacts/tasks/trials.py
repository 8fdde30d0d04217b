"""Trials: results of one policy, or of replayed demonstrations, in one task of one world."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np

from dextera_build.artifacts.base import Array, Artifact, Value
from dextera_build.artifacts.tasks.episode import Episode, Episodes
from dextera_build.artifacts.tasks.reasons import tally
from dextera_build.artifacts.tasks.task import TaskSpec, WorldKind

Actor = Literal["policy", "replay"]
"""`policy`: closed loop. `replay`: joint targets that succeeded in the twin, sent open loop."""


Poses = Literal["exact", "tracked"]
"""Source of a policy's object poses: `exact` from the simulator, `tracked` from a tracker on frames of its camera,
placed by a calibration."""


class Sighting(Value):
    """Accuracy of a tracker for the task's object in one trial, compared with the truth."""

    found_s: float | None
    """Time until the object was found before the trial [s]; None: not found."""
    frames: int
    """Frames that arrived during the trial."""
    tracked: int
    """Frames among these in which its pose was confirmed."""
    distances_m: tuple[float, ...]
    """Distance of its origin from the true one, per such frame [m]."""
    angles_rad: tuple[float, ...]
    """Angle to its true orientation, per such frame [rad]."""
    joints_rad: tuple[float, ...]
    """Largest error of its joints, per such frame [rad or m]; empty without joints."""
    success: bool | None = None
    """Success judged from measurements by the same predicate; None: not evaluated."""


class Verdicts(Value):
    """Judgements of a trial on a robot, where no true state is known."""

    measured: bool
    """By the task's predicate, from what was measured."""
    operator: bool | None
    """By the operator, whose verdict counts; None: not asked."""


class Trial(Value):
    """One attempt from one start."""

    seed: int
    """Seed of the start; the same seed means the same start for every policy in a world. Of a run on a robot, whose
    start has none, a number of its recording."""
    start: str
    """Digest of the start: positions, joint targets and dynamics."""
    success: bool
    """Result of the task's success predicate."""
    reason: str
    """Reason for the failure; empty for a success."""
    steps: int
    """Control periods until it ended."""
    stage: int
    """The last of `Trials.stages` that was reached at any time, by the true state, from 1; 0: none."""
    sighting: Sighting | None = None
    """Accuracy of the tracker; None for exact poses."""
    verdicts: Verdicts | None = None
    """How it was judged on a robot; None in a simulation, whose true state is known."""


class Attempt(Artifact):
    """Complete outcome of one seed: a trial, or the reason for its exclusion."""

    seed: int
    """Seed of the start."""
    episode: Episode | None = None
    """The trial, or None if excluded."""
    placed: Annotated[np.ndarray, Array("O 7", "float32", frame="base")] | None = None
    """Poses of the bundle's objects at the start."""
    excluded: str = ""
    """Reason of the exclusion."""
    stage: int = 0
    """The last stage of its primitive that was reached before success, from 1; 0: none."""
    rehearsal: Episode | None = None
    """The rollout in the twin that is replayed."""
    sighting: Sighting | None = None
    """Accuracy of the tracker; None for exact poses."""
    verdicts: Verdicts | None = None
    """How it was judged on a robot; None in a simulation."""


class Trials(Artifact):
    """Trials of one actor in one task of one world. Equal seeds give equal starts."""

    actor: Actor
    """Source of the actions."""
    label: str
    """Its name in tables: `ACT`, `PPO`, `replay`."""
    algorithm: str
    """Training algorithm of the policy, `act` or `ppo`; `script` for a scripted operator, empty for a replay."""
    source: str
    """Digest of the checkpoint, of the replayed demonstrations, or of the operator's twin."""
    task: TaskSpec
    """The objective and its success criterion."""
    embodiment: str
    """Digest of joint names and limits."""
    robot: str
    """Name of the robot's model."""
    world: WorldKind
    """Kind of world; `real` for trials on a robot."""
    poses: Poses = "exact"
    """Source of the actor's object poses."""
    stages: tuple[str, ...]
    """Steps on the way to success, in order; the last one is success."""
    stopped: bool = False
    """Whether the results decided when the trials ended; then no interval for a fixed number of trials holds."""
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
    def progress(self) -> np.ndarray:
        """Fraction of the stages that each attempt reached (N,); 1 for a success."""
        return np.array([trial.stage / len(self.stages) for trial in self.items], np.float64)

    @property
    def reasons(self) -> dict[str, int]:
        """Reason of failure -> count, most frequent first."""
        return tally(trial.reason for trial in self.items if not trial.success)

    @property
    def mean_time_s(self) -> float | None:
        """Mean time of the successes [s], including the hold time; None without successes."""
        steps = [trial.steps for trial in self.items if trial.success]
        return float(np.mean(steps)) / self.task.control_hz if steps else None


class Operated(Artifact):
    """Trials of one operator rehearsed in a twin, from the same seeds in several worlds."""

    twin: Trials
    """In the twin itself."""
    world: Trials
    """In the other world, with exact poses."""
    cell: Trials | None = None
    """In the other world, with poses from a tracker; None without a cell."""


class Compared(Artifact):
    """Trials of two policies on the same starts in one world, until it was decided which one is better."""

    first: Trials
    """Those of the first policy."""
    second: Trials
    """Those of the second policy."""
    decided: int | None
    """Number of starts after which the better one was known; None: it stayed open."""

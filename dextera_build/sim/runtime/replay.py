"""Cross-domain replay: trajectories that succeed in the twin are executed open loop in another world."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.tasks.episode import Episode, Start
from dextera_build.errors import RuleError
from dextera_build.policy.observation import Measurement
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.reconstruction import Tracker, reconstruct
from dextera_build.sim.runtime.recorder import Recorder
from dextera_build.sim.runtime.rollout import SimulatedCell, begin, open_loop, through_cell
from dextera_build.sim.runtime.seeds import seed_of

Synthesise = Callable[[Start, int], Episode]
"""A rollout in the twin from a start, by a seed; successful or with a reason."""


@dataclass(frozen=True)
class Replayed:
    """The outcome of one reset."""

    episode: Episode | None = None
    """The replay in the other world, or None without a success in the twin."""
    placed: np.ndarray | None = None
    """Poses (O, 7) of the objects at the reset, in the base frame."""
    rehearsal: Episode | None = None
    """The replayed rollout in the twin."""
    reason: str = ""
    """Reason for a missing replay."""


class Replay:
    """Replays trajectories of a twin in another world.

    Args:
        twin: Environment in which trajectories are synthesised.
        world: Environment in which they are replayed; same task, robot and objects.
        synthesise: Synthesis in `twin`.
        tries: Maximum number of syntheses per reset until one succeeds.
        tracker: Errors that are added to the measured poses of objects.
        cell: Measures `world` instead of the simulator.
        linger_s: Time to hold the last target after the trajectory [s].
        records: Whether targets pass the cell's guard, too, and the episode is that of `through_cell`.
    """

    def __init__(
        self,
        twin: Environment,
        world: Environment,
        synthesise: Synthesise,
        *,
        tries: int,
        tracker: Tracker | None = None,
        cell: SimulatedCell | None = None,
        linger_s: float = 1.0,
        records: bool = False,
    ) -> None:
        self._records = records
        self._twin, self._world = twin, world
        self._synthesise, self._tries = synthesise, tries
        self._tracker, self._cell, self._linger_s = tracker or Tracker(), cell, linger_s

    def attempt(self, seed: int) -> Replayed:
        """Reset the world with `seed`, measure it, synthesise a success in the twin, and replay it."""
        try:
            start = self._world.draw(seed)
        except RuleError as error:
            return Replayed(reason=error.message)
        refused = begin(self._world, start, self._cell)
        placed = self._world.object_poses()
        if refused:
            failed = Recorder(self._world).episode("replay", success=False, reason=refused)
            return Replayed(failed, placed)
        seen = reconstruct(self._measured(), self._world.previous_action, self._twin, self._tracker, seed)
        reason = ""
        for number in range(self._tries):
            rehearsal = self._synthesise(seen, seed_of("rehearsal", seed, number))
            if rehearsal.success:
                return Replayed(self._replayed(start, rehearsal), placed, rehearsal)
            reason = rehearsal.reason
        return Replayed(reason=f"no success in the twin: {reason}")

    def _replayed(self, start: Start, rehearsal: Episode) -> Episode:
        if self._records and self._cell is not None:
            return through_cell(self._world, self._cell, rehearsal, self._linger_s)
        return open_loop(self._world, start, rehearsal.executed, self._linger_s)

    def _measured(self) -> Measurement:
        """Tracked poses in the world, in the twin's order of objects and joints."""
        measured = self._world if self._cell is None else self._cell
        seen, here, there = measured.measure(), self._twin.bundle.objects, self._world.bundle.objects
        rows = [list(there).index(name) for name in here]
        inner = [joint for thing in there.values() for joint in thing.joints]
        columns = [inner.index(joint) for thing in here.values() for joint in thing.joints]
        return Measurement(seen.joints, seen.objects[rows], seen.displacement[columns])

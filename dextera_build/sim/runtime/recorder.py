"""Record one episode at control rate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dextera_build.artifacts.tasks.episode import Episode, Origin, Segment
from dextera_build.policy.declared import BY_NAME, DECLARED
from dextera_build.policy.layout import of_bundle
from dextera_build.policy.observation import DeployableObservation
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.privileged import MEASURES, Simulated

COMMANDED = ("action", "executed", "hand")
"""Recorded fields of an episode that are no observations."""


class Recorder:
    """Collects the rows of one episode.

    Call `before(action, hand)` with the next command, step the environment, then `after(executed)`.

    Args:
        environment: An environment at the start of its episode.
        measured: Record only what a cell measures, which `before` is given: nothing that only a simulator knows.
    """

    def __init__(self, environment: Environment, *, measured: bool = False) -> None:
        self._environment = environment
        layout = of_bundle(environment.bundle, terms=environment.specs)
        layout = replace(layout, tips=()) if measured else layout
        self._terms = [term for term in (*DECLARED, *layout.added) if term.recorded]
        self._hidden = {term.name: MEASURES[term.name] for term in self._terms if term.seen_by == "critics"}
        self._measured = measured
        self._simulated = Simulated([environment])
        fields = (*self._terms, *(BY_NAME[name] for name in COMMANDED))
        self._shapes = {term.name: layout.shape(term) for term in fields}
        self._rows: dict[str, list[np.ndarray]] = {name: [] for name in self._shapes}

    def __len__(self) -> int:
        return len(self._rows["executed"])

    def before(
        self, action: np.ndarray, hand: np.ndarray | None = None, seen: DeployableObservation | None = None
    ) -> None:
        """Record the observation, the action (A,) [rad] taken on it, and its palm poses (L, 7) in the base.

        `seen` is what a cell measured; without it, the exact state is recorded.
        """
        environment, rows = self._environment, self._rows
        rows["action"].append(np.asarray(action, np.float32))
        rows["hand"].append(environment.palm_poses() if hand is None else hand)
        shown = environment.observe() if seen is None else seen
        for term in self._terms:
            rows[term.name].append(self._hidden_value(term.name) if term.name in self._hidden else shown[term.name])

    def _hidden_value(self, name: str) -> np.ndarray:
        return np.zeros(self._shapes[name]) if self._measured else self._hidden[name](self._simulated)[0]

    def after(self, executed: np.ndarray) -> None:
        """Record the executed command."""
        self._rows["executed"].append(np.asarray(executed))

    def episode(self, origin: Origin, *, success: bool, reason: str = "", segments: Sequence[Segment] = ()) -> Episode:
        """The episode so far. A non-finite action is stored as 0; the reason reports it."""
        rows = {name: self._stacked(name) for name in self._rows}
        return Episode(
            start=self._environment.start,
            origin=origin,
            success=success,
            reason=reason,
            segments=tuple(segments),
            goal=self._environment.goal,
            **{name: rows[name] for name in COMMANDED},
            terms={term.name: rows[term.name] for term in self._terms},
        )

    def _stacked(self, name: str) -> np.ndarray:
        values = np.array(self._rows[name][: len(self)], np.float32)
        return np.nan_to_num(values.reshape(len(self), *self._shapes[name]))

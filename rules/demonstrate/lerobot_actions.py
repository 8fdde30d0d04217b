"""Conversion of recorded actions to the kind that the task states."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.tasks.episode import Episode
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.policy import actions, features

if TYPE_CHECKING:
    from dextera_build.sim.control.action_map import ActionMap


class Actions:
    """Names and values of actions, and their description in `meta/dextera.json`.

    Args:
        bundle: The task, which states the kind.
    """

    def __init__(self, bundle: TaskBundle) -> None:
        self.spec = actions.of_task(bundle.task, bundle.robot)
        """Names, limits and rate."""
        self._bundle = bundle

    def of(self, episode: Episode) -> np.ndarray:
        """Values at every step (T, N): joint targets are those recorded, other kinds are computed from them."""
        if self.spec.kind == "joint":
            return episode.action
        sent = features.recorded(episode)["previous_action"].astype(np.float64)
        pairs = zip(episode.action.astype(np.float64), sent, strict=True)
        found = [self._map.actions(targets, before) for targets, before in pairs]
        return np.array(found, np.float32).reshape(len(found), len(self.spec.names))

    @cached_property
    def _map(self) -> ActionMap:
        from dextera_build.sim.control.action_map import ActionMap

        return ActionMap(self._bundle.task, self._bundle.robot)

    def about(self) -> dict[str, object]:
        """Kind, meaning, units, rate [Hz] and limits."""
        meaning, units = actions.ABOUT[self.spec.kind]
        limits = {"lower": self.spec.lower.tolist(), "upper": self.spec.upper.tolist()}
        return {"kind": self.spec.kind, "meaning": meaning, "units": units, "rate_hz": self.spec.rate_hz, **limits}

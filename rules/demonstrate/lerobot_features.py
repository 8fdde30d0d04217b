"""The steps of an episode as LeRobot's features and columns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.tasks.episode import Episode, Episodes
from dextera_build.policy.declared import BY_NAME
from dextera_build.policy.layout import of_episodes
from dextera_build.policy.terms import Term

ACTION = BY_NAME["action"].feature
"""The feature to learn."""


@dataclass(frozen=True)
class Feature:
    """One column of the data set."""

    dtype: str
    names: tuple[str, ...] | None
    """Names of the components; None: an unnamed number."""

    @property
    def width(self) -> int:
        """Numbers per step."""
        return len(self.names) if self.names else 1

    def facts(self) -> dict[str, object]:
        """The feature's entry in `meta/info.json`."""
        return {"dtype": self.dtype, "shape": [self.width], "names": list(self.names) if self.names else None}


def features(episodes: Episodes, goal: tuple[str, ...], action: tuple[str, ...] | None = None) -> dict[str, Feature]:
    """Features by name, without empty ones; observations are the terms that have a feature in `declared`.

    LeRobot's policies use features whose names start with `observation` or `action`, so other features are named
    differently: `executed_action` is `action` with noise as sent, `target.hand` the palm pose for `action`,
    concatenated for several limbs, `privileged.contact` the force on the fingertips.

    Args:
        episodes: Names and shapes of the channels.
        goal: Names of the goal's components.
        action: Names of the numbers of an action; None: joint targets.
    """
    vectors = {
        name: tuple(part for term in terms for part in term.components) for name, terms in _by_feature(episodes, goal)
    }
    vectors[ACTION] = vectors[ACTION] if action is None else action
    found = {name: Feature("float32", parts) for name, parts in vectors.items()}
    found |= {"next.done": Feature("bool", None), "next.success": Feature("bool", None)}
    found["timestamp"] = Feature("float32", None)
    return found | {name: Feature("int64", None) for name in ("frame_index", "episode_index", "index", "task_index")}


def columns(
    episodes: Episodes, episode: Episode, number: int, first: int, action: np.ndarray | None = None
) -> dict[str, np.ndarray]:
    """Arrays (T, N) by feature.

    Args:
        episodes: Names and rate of the channels.
        episode: The episode.
        number: Its index among the kept episodes.
        first: Number of steps in the episodes before it.
        action: Its actions (T, N), if they are not joint targets.
    """
    steps = len(episode.joints)
    frame = np.arange(steps)
    last = frame == steps - 1
    goal = tuple(str(part) for part in range(len(episode.goal)))  # names are not needed here
    values: dict[str, np.ndarray] = {
        name: np.concatenate([_recorded(episode, term) for term in terms], axis=1)
        for name, terms in _by_feature(episodes, goal)
    }
    values[ACTION] = values[ACTION] if action is None else action.astype(np.float32)
    values |= {
        "next.done": last,
        "next.success": last & episode.success,
        "timestamp": (frame / episodes.rate_hz).astype(np.float32),
        "frame_index": frame,
        "episode_index": np.full(steps, number),
        "index": first + frame,
        "task_index": np.zeros(steps, np.int64),
    }
    return {name: value.reshape(steps, -1) for name, value in values.items()}


def _by_feature(episodes: Episodes, goal: tuple[str, ...]) -> list[tuple[str, list[Term]]]:
    """Features of numbers with their terms, in the order of the terms."""
    found: dict[str, list[Term]] = {}
    for term in of_episodes(episodes, goal).terms():
        if term.feature:
            found.setdefault(term.feature, []).append(term)
    return list(found.items())


def _recorded(episode: Episode, term: Term) -> np.ndarray:
    """Values of a term at every step (T, N)."""
    values = episode.values(term.declared.name)
    steps = len(episode.joints)
    return np.tile(values, (steps, 1)) if term.declared.name == "goal" else values.reshape(steps, -1)

"""Pictures of a set of episodes: where they begin as a map, and their actions as curves."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.tasks.episode import Episode, Episodes
from dextera_build.geometry.plot import COLOURS, Line, plot

KEPT, DISCARDED = COLOURS[0], COLOURS[1]
CURVES, JOINTS = 20, 3
"""Maximum numbers of episodes and of joints that are drawn as curves."""


def starts(episodes: Episodes) -> tuple[str, np.ndarray] | None:
    """The object whose start varies most, and the map (H, W, 3) uint8 of its starts in the base: kept, discarded."""
    kept, discarded = (_begun(episodes, list(part.values())) for part in (episodes.items, episodes.failures))
    every = np.concatenate([kept, discarded])
    if not every.size:
        return None
    row = int(every.std(axis=0).sum(axis=1).argmax())
    dots = [Line(kept[:, row], KEPT, dots=True), Line(discarded[:, row], DISCARDED, dots=True)]
    return episodes.object_names[row], plot(dots, "x [m]", "y [m]", equal=True)


def actions(episodes: Episodes) -> tuple[tuple[str, ...], np.ndarray] | None:
    """The joints that move most, and the picture (H, W, 3) uint8 of their targets over time."""
    shown = [episode.action for _, episode in episodes.in_order()[:CURVES] if len(episode.action)]
    if not shown:
        return None
    moved = np.mean([np.ptp(action, axis=0) for action in shown], axis=0)
    columns = np.argsort(-moved, kind="stable")[:JOINTS]
    lines = [
        Line(np.stack([np.arange(len(action)) / episodes.rate_hz, action[:, column]], axis=1), COLOURS[number])
        for number, column in enumerate(columns)
        for action in shown
    ]
    return tuple(episodes.joint_names[column] for column in columns), plot(lines, "time [s]", "[rad]")


def _begun(episodes: Episodes, parts: list[Episode]) -> np.ndarray:
    """X and y (N, O, 2) of the objects at the first step; an attempt without a step has none."""
    seen = [episode.objects[0, :, :2] for episode in parts if len(episode.objects)]
    return np.array(seen, np.float64).reshape(len(seen), len(episodes.object_names), 2)

"""Division of episodes into those to train on and those to validate on, by their starts."""

from __future__ import annotations

from dextera_build import digest
from dextera_build.artifacts.tasks.episode import Episodes

BITS = 64


def validation(episodes: Episodes, share: float) -> frozenset[str]:
    """Labels of the episodes to validate on.

    The seed of its start decides about an episode, so all episodes from one start are on one side, and an episode stays
    on its side when others are added. If chance leaves a side empty, the start nearest to the limit changes sides.

    Args:
        episodes: Those of the data set.
        share: Expected share of the starts to validate on, 0..1; 0: none.
    """
    drawn = {label: _drawn(episode.start.seed) for label, episode in episodes.items.items()}
    values = sorted(set(drawn.values()))
    if share <= 0 or len(values) < 2:
        return frozenset()
    limit = max(share, values[0])
    if limit >= values[-1]:
        limit = values[-2]
    return frozenset(label for label, value in drawn.items() if value <= limit)


def _drawn(seed: int) -> float:
    """A number in 0..1 that looks random and follows from the seed."""
    return int(digest.of_value(["split", seed])[: BITS // 4], 16) / 2.0**BITS

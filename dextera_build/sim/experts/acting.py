"""Limbs of a robot that act in a demonstration."""

from __future__ import annotations

from collections.abc import Sequence

from dextera_build.artifacts.tasks.episode import Episode


def acting(episode: Episode, limbs: Sequence[str]) -> tuple[int, ...]:
    """Indices of the limbs that move in any segment, in order; the first limb if segments name none.

    Args:
        episode: A demonstration.
        limbs: Limbs of `Episode.hand`.
    """
    named = {name for segment in episode.segments for name in segment.limbs}
    return tuple(number for number, name in enumerate(limbs) if name in named) or (0,)

"""demonstrate.synthesize without a simulator: repeats the demonstrations."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dextera_build.artifacts.tasks.episode import Episodes, Shard
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.rule import Backend, Context, Options

if TYPE_CHECKING:
    from .synthesize import SynthesizeOptions

BACKEND = Backend(summary="no simulation: the demonstrations over again", profiles=("stub",))


def synthesize(
    ctx: Context,
    bundle: TaskBundle,
    sources: Episodes,
    shard: Shard,
    terms: tuple[TermSpec, ...],
    common: SynthesizeOptions,
    options: Options,
) -> Episodes:
    """Return the shard's number of episodes."""
    demonstrations = list(sources.items.values())
    items = {
        f"{shard.first + number:05d}": demonstrations[number % len(demonstrations)].model_copy(
            update={"origin": "synthesis"}
        )
        for number in range(shard.count)
    }
    return sources.model_copy(update={"items": items, "failures": {}, "attempts": shard.count})

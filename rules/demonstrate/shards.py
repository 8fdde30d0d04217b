"""demonstrate.shards: split a data set into shards that are built in parallel."""

from __future__ import annotations

from pydantic import NonNegativeInt, PositiveInt

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.tasks.episode import Shard
from dextera_build.rule import Context, Options, rule


class ShardsOptions(Options):
    """Options of demonstrate.shards."""

    episodes: PositiveInt = 100
    """Number of episodes in the data set."""
    per_shard: PositiveInt = 10
    """Number of episodes per shard."""
    seed: NonNegativeInt = 0
    """Seed of the data set; every episode's seed is derived from it and the episode's index."""


@rule(version=1)
def shards(ctx: Context, *, options: ShardsOptions) -> Collection[Shard]:
    """Return the shards of a data set, for `each`; a larger data set starts with the shards of a smaller one."""
    parts = {}
    for first in range(0, options.episodes, options.per_shard):
        count = min(options.per_shard, options.episodes - first)
        parts[f"{first:05d}"] = Shard(first=first, count=count, seed=options.seed)
    ctx.say(f"{options.episodes} episodes in {len(parts)} shards")
    return Collection[Shard](items=parts)

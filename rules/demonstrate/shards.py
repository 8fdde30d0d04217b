"""demonstrate.shards: split a data set into parts that are made side by side."""

from __future__ import annotations

from pydantic import NonNegativeInt, PositiveInt

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.episode import Shard
from dextera_build.rule import Context, Options, rule


class ShardsOptions(Options):
    """Options of demonstrate.shards."""

    episodes: PositiveInt = 100
    """Episodes of the data set."""
    per_shard: PositiveInt = 10
    """Episodes of one part."""
    seed: NonNegativeInt = 0
    """Seed of the data set; every episode's own is derived from it and from its index."""


@rule(version=1)
def shards(ctx: Context, *, options: ShardsOptions) -> Collection[Shard]:
    """Return the parts of a data set, for `each` to open; a larger data set begins with the parts of a smaller one."""
    parts = {}
    for first in range(0, options.episodes, options.per_shard):
        count = min(options.per_shard, options.episodes - first)
        parts[f"{first:05d}"] = Shard(first=first, count=count, seed=options.seed)
    ctx.say(f"{options.episodes} episodes in {len(parts)} shards")
    return Collection[Shard](items=parts)

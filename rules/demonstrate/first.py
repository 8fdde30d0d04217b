"""demonstrate.first: some of many episodes, to film them."""

from __future__ import annotations

from itertools import islice

from pydantic import PositiveInt

from dextera_build.artifacts.episode import Episodes
from dextera_build.rule import Context, Options, rule


class FirstOptions(Options):
    """Options of demonstrate.first."""

    episodes: PositiveInt = 1
    """Number of successful episodes."""


@rule(version=1)
def first(ctx: Context, episodes: Episodes, *, options: FirstOptions | None = None) -> Episodes:
    """Return the first successful episodes, and none of the failures."""
    options = options or FirstOptions()
    kept = dict(islice(episodes.items.items(), options.episodes))
    ctx.say(f"{len(kept)} of {len(episodes.items)}")
    return episodes.model_copy(update={"items": kept, "failures": {}, "attempts": len(kept)})

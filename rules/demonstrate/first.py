"""demonstrate.first: select the first episodes, for filming."""

from __future__ import annotations

from itertools import islice

from pydantic import PositiveInt

from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.rule import Context, Options, rule


class FirstOptions(Options):
    """Options of demonstrate.first."""

    episodes: PositiveInt = 1
    """Number of successful episodes."""
    failed: bool = False
    """Whether to keep the longest failed attempt if none succeeded, to show the failure."""


@rule(version=2)
def first(ctx: Context, episodes: Episodes, *, options: FirstOptions | None = None) -> Episodes:
    """Return the first successful episodes, and no failures unless option `failed` is set."""
    options = options or FirstOptions()
    kept = dict(islice(episodes.items.items(), options.episodes))
    ctx.say(f"{len(kept)} of {len(episodes.items)}")
    if options.failed and not kept and episodes.failures:
        name, episode = max(episodes.failures.items(), key=lambda item: len(item[1].joints))
        kept = {name: episode}
        ctx.say(f"no success; failed: {episode.reason}")
    return episodes.model_copy(update={"items": kept, "failures": {}, "attempts": len(kept)})

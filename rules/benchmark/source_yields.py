"""benchmark.source_yields: the demonstrations that synthesised episodes come from, and the segments that lose some."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from dextera_build.artifacts.table import Cell, Column, Table
from dextera_build.artifacts.tasks.episode import Episode, Episodes
from dextera_build.artifacts.tasks.reasons import spelled
from dextera_build.rule import Context, rule
from dextera_build.statistics import Rate

from .yield_picture import yield_picture

UNKNOWN = "-"
"""Source of an attempt that none is known of, and segment of one without a command."""


@rule(version=1, packages=("numpy", "pillow"))
def source_yields(ctx: Context, episodes: Episodes) -> Table:
    """Return one row per demonstration: attempts from it, yield [%] with 95 % Wilson interval, and losses by segment.

    A demonstration counts for the attempts that begin with it. An attempt is lost in the last segment that was
    executed: the one in which a filter discarded it, or at the end of which the task was not done.
    """
    ctx.check(
        bool(episodes.items or episodes.failures),
        "there are no episodes",
        hint="give the output of `demonstrate.gather`",
    )
    attempts = [episode for _, episode in (*episodes.in_order(), *sorted(episodes.failures.items()))]
    names = sorted({_source(episode) for episode in attempts}, key=lambda name: (len(name), name))
    lost = {name: Counter[str]() for name in names}
    for episode in attempts:
        if not episode.success:
            lost[_source(episode)][_last(episode)] += 1
    segments = [name for name in _ordered(attempts) if any(count[name] for count in lost.values())]
    done = Counter(_source(episode) for episode in attempts if episode.success)
    tried = Counter(_source(episode) for episode in attempts)
    rows = [_row(name, Rate(done[name], tried[name]), [lost[name][each] for each in segments]) for name in names]
    whole = Rate(sum(done.values()), len(attempts))
    rows.append(_row("all", whole, [sum(count[each] for count in lost.values()) for each in segments]))
    ctx.preview(yield_picture(names, done, lost, segments), "attempts by demonstration: kept (blue), lost by segment")
    ctx.metric("yield", 100 * whole.value, "%")
    ctx.say(f"{whole.successes} of {whole.trials} attempts from {len(names)} demonstrations")
    return Table(
        title=f"Yield of {episodes.task} by demonstration and segment",
        columns=(
            *(Column(name=name) for name in ("demonstration", "attempts", "kept")),
            *(Column(name=name, unit="%", digits=0) for name in ("yield", "low", "high")),
            *(Column(name=f"lost in {name}") for name in segments),
        ),
        rows=tuple(rows),
        notes=(
            "low, high: 95 % Wilson interval",
            f"reasons: {spelled(episodes.reasons, most=8) or 'none'}",
        ),
    )


def _row(name: str, rate: Rate, lost: Sequence[int]) -> tuple[Cell, ...]:
    return (name, rate.trials, rate.successes, *(100 * each for each in (rate.value, *rate.interval())), *lost)


def _source(episode: Episode) -> str:
    return episode.sources[0] if episode.sources else UNKNOWN


def _last(episode: Episode) -> str:
    return max(episode.segments, key=lambda each: (each.last, each.first)).name if episode.segments else UNKNOWN


def _ordered(attempts: Sequence[Episode]) -> list[str]:
    """Names of all segments in the order of the longest attempt."""
    longest = sorted(attempts, key=lambda episode: -len(episode.segments))
    return list(dict.fromkeys([*(each.name for episode in longest for each in episode.segments), UNKNOWN]))

"""benchmark.yields: attempts per data set, and why episodes were discarded."""

from __future__ import annotations

from pydantic import PositiveInt

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.table import Cell, Column, Table
from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.reasons import spelled
from dextera_build.rule import Context, Options, rule
from dextera_build.statistics import Rate

from .set_pictures import actions, starts


class YieldsOptions(Options):
    """Options of benchmark.yields."""

    reasons: PositiveInt = 4
    """Maximum number of reasons listed, most frequent first."""


@rule(version=2, packages=("numpy", "pillow"))
def yields(ctx: Context, episodes: Collection[Episodes], *, options: YieldsOptions) -> Table:
    """Return one row per data set: attempts, yield [%] with 95 % Wilson interval, length [s], failure reasons.

    The report has, for every set, a map of the starts and curves of the actions.
    """
    ctx.check(bool(episodes.items), "there are no episodes", hint="give the outputs of `demonstrate.gather`")
    rows: list[tuple[Cell, ...]] = []
    total = Rate(0, 0)
    for label, part in sorted(episodes.items.items(), key=lambda item: (item[1].task, item[0])):
        ctx.check(
            part.attempts >= len(part.items),
            f"`{label}` has more episodes than attempts",
            episodes=len(part.items),
            attempts=part.attempts,
        )
        rate = Rate(len(part.items), part.attempts)
        total = Rate(total.successes + rate.successes, total.trials + rate.trials)
        rows.append(_row(label, part, rate, options.reasons))
        _show(ctx, label, part)
    ctx.metric("yield", 100 * total.value, "%")
    ctx.say(f"{total.successes:,} episodes from {total.trials:,} attempts ({100 * total.value:.0f} %)")
    return Table(
        title="Yield of demonstrations",
        columns=(
            *(Column(name=name) for name in ("episodes", "task", "world", "actor", "attempts", "successes")),
            Column(name="yield", unit="%", digits=1, better="higher"),
            Column(name="low", unit="%", digits=1),
            Column(name="high", unit="%", digits=1),
            Column(name="mean length", unit="s", digits=2),
            Column(name="sorted out"),
        ),
        rows=tuple(rows),
        notes=(
            "yield: episodes that count, of all attempts; low, high: 95 % Wilson interval",
            "sorted out: attempts that failed or that a filter refused, with the reason that came first",
        ),
    )


def _row(label: str, part: Episodes, rate: Rate, most: int) -> tuple[Cell, ...]:
    low, high = rate.interval()
    actors = sorted({episode.origin for episode in part.items.values()})
    steps = [len(episode.action) for episode in part.items.values()]
    length = sum(steps) / len(steps) / part.rate_hz if steps else None
    lost = part.attempts - len(part.items) - len(part.failures)
    reasons = part.reasons | ({"not kept": lost} if lost > 0 else {})
    percent = [100 * number for number in (rate.value, low, high)]
    sorted_out = spelled(reasons, most) or None
    return (label, part.task, part.world, ", ".join(actors), rate.trials, rate.successes, *percent, length, sorted_out)


def _show(ctx: Context, label: str, part: Episodes) -> None:
    if begun := starts(part):
        name, picture = begun
        ctx.preview(picture, f"{label}: starts of {name} in the base, kept (blue) and discarded (orange)")
    if sent := actions(part):
        names, picture = sent
        ctx.preview(picture, f"{label}: targets of {', '.join(names)}")

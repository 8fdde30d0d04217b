"""evaluate.paired: two sets of trials from the same starts, compared trial by trial."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from pydantic import Field

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.table import Cell as Entry
from dextera_build.artifacts.table import Column, Table
from dextera_build.artifacts.tasks.trials import Trials
from dextera_build.rule import Context, rule
from dextera_build.statistics import Paired, decided, mean_difference
from dextera_build.statistics import paired as counts_of

from .series import Cell, Series, SeriesOptions

NEAR_M = 0.001
"""Maximum distance between poses that count as equal [m]."""
NEAR = 0.01
"""Maximum distance between unit quaternions of equal poses (about 1 deg)."""


class PairedOptions(SeriesOptions):
    """Options of evaluate.paired."""

    alpha: float = Field(0.05, gt=0, lt=1)
    """Probability of naming one side the better one if neither is."""


@rule(version=2, packages=("numpy",))
def paired(ctx: Context, trials: Collection[Trials], *, options: PairedOptions) -> Table:
    """Return one row per pair of trial sets of a task, of two actors or in two worlds, with McNemar's p and an e-value.

    Trials are matched by the seed of their start; unmatched trials are omitted. The e-value holds whenever the trials
    ended, p only for a number that was chosen beforehand.
    """
    series = Series(ctx, trials, options.robots)
    found = [
        (one, other, counts_of(*one.against(other)))
        for one, other in combinations(series.cells, 2)
        if _comparable(one, other) and one.shared(other)
    ]
    rows = [_row(one, other, verdicts, options.alpha) for one, other, verdicts in found]
    ctx.check(
        bool(rows),
        "no two sets of trials share a start",
        hint="give `evaluate.rollouts` of one task the same `seed`",
        sets=", ".join(f"{cell.label} in {cell.pair} ({cell.world})" for cell in series.cells[:6]),
    )
    clear = sum(row[-1] is not None for row in rows)
    ctx.say(f"{len(rows)} comparisons on the same starts, {clear} decided")
    return Table(
        title="Comparisons on the same starts",
        columns=(
            *(Column(name=name) for name in ("task", "first", "second", "starts", "placed alike")),
            *(Column(name=name) for name in ("both", "only first", "only second", "neither")),
            *(Column(name=name, unit="%", digits=1) for name in ("difference", "from", "to")),
            Column(name="p", digits=4),
            Column(name="e", digits=2),
            Column(name="decided after"),
        ),
        rows=(*rows, *_means(found)),
        notes=(
            "starts: seeds that both sides tried",
            "placed alike: starts at which every object stood within 1 mm and about 1° of the same place",
            "difference: success of the first minus that of the second, with its 95 % interval (Newcombe 1998); a dash"
            " if the results decided when the trials ended; means count every task the same",
            "p: McNemar's exact test, two-sided; a dash if the results decided when the trials ended",
            f"e: e-value of `neither is better`, by bets on the starts that only one side solves; it ever reaches"
            f" {1 / options.alpha:.0f} with a probability of at most {options.alpha:g}, whenever one stops",
            f"decided after: number of starts after which e was {1 / options.alpha:.0f} for the first time",
            "neither p nor e is corrected for the number of comparisons",
        ),
    )


def _comparable(one: Cell, other: Cell) -> bool:
    """Whether two cells share the task and either world or actor; replays are selected by success, policies are not."""
    alike = one.pair == other.pair and one.trials.actor == other.trials.actor
    return alike and (one.world == other.world or one.label == other.label)


def _row(one: Cell, other: Cell, verdicts: Paired, alpha: float) -> tuple[Entry, ...]:
    shared, both = one.shared(other), one.against(other)
    alike = sum(_alike(one.trials.placed[here], other.trials.placed[there]) for here, there in shared)
    counts = (verdicts.both, verdicts.first, verdicts.second, verdicts.neither)
    stopped = one.trials.stopped or other.trials.stopped
    apart = (None,) * 3 if stopped else tuple(100 * each for each in verdicts.difference())
    p = None if stopped else verdicts.p
    ends = (p, verdicts.e, decided(*both, alpha))
    return (str(one.pair), *_names(one, other), len(shared), alike, *counts, *apart, *ends)


def _names(one: Cell, other: Cell) -> tuple[str, str]:
    return f"{one.label}, {one.world}", f"{other.label}, {other.world}"


def _means(found: Sequence[tuple[Cell, Cell, Paired]]) -> list[tuple[Entry, ...]]:
    """One row for each two sides that were compared on several tasks."""
    sides: dict[tuple[str, str], list[Paired]] = {}
    for one, other, verdicts in found:
        if not (one.trials.stopped or other.trials.stopped):
            sides.setdefault(_names(one, other), []).append(verdicts)
    empty = (None,) * 5
    return [
        (f"mean of {len(pairs)}", *names, *empty, None, *(100 * each for each in mean_difference(pairs)), *empty[:3])
        for names, pairs in sides.items()
        if len(pairs) > 1
    ]


def _alike(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether poses (O, 7) are equal; q and -q are the same rotation."""
    if one.shape != other.shape:
        return False
    apart = np.linalg.norm(one[:, :3] - other[:, :3], axis=1)
    turned = 1.0 - np.abs((one[:, 3:] * other[:, 3:]).sum(axis=1))
    return bool((apart < NEAR_M).all() and (turned < NEAR**2 / 2).all())

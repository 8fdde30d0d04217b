"""evaluate.better: run two policies from the same starts until one of them is known to be the better one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Protocol

import numpy as np
from pydantic import Field

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.robots.cell import Cell
from dextera_build.artifacts.tasks.episode import Episode
from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.artifacts.tasks.trials import Attempt, Compared
from dextera_build.policy import contract as contracts
from dextera_build.policy.added import listed
from dextera_build.policy.cameras import given
from dextera_build.rule import Context, Options, rule
from dextera_build.statistics import decided

from .attempts import resumed
from .protocol import TOLERANCE, Record, close, policy_label, same_task, seeds
from .strip import first_of, show


class BetterOptions(Options):
    """Options of evaluate.better."""

    trials: int = Field(100, ge=1)
    """Number of starts after which the comparison stays open."""
    alpha: float = Field(0.05, gt=0, lt=1)
    """Probability of naming one policy the better one if neither is."""
    seed: int = Field(0, ge=0)
    """Seed of the starts."""
    first_label: str = ""
    """Name of the first policy in tables; empty: its algorithm, `ACT`, or `ACT image` for an image policy."""
    second_label: str = ""
    """Name of the second policy in tables."""
    strip_frames: int = Field(6, ge=2)
    """Pictures in each film strip."""


class BetterBackend(Protocol):
    """Interface of a backend of evaluate.better."""

    def better(
        self,
        ctx: Context,
        bundle: TaskBundle,
        checkpoints: Mapping[str, Checkpoint],
        views: Mapping[str, View],
        cell: Cell | None,
        twin: TaskBundle | None,
        cases: list[tuple[str, int]],
        terms: tuple[TermSpec, ...],
        options: Any,
    ) -> Iterator[Attempt]:
        """One attempt per case, in order, each independent of the earlier ones: `first` or `second`, and a seed."""
        ...

    def stills(
        self, ctx: Context, bundle: TaskBundle, episode: Episode, rows: np.ndarray, view: View | None, options: Any
    ) -> np.ndarray | None:
        """Pictures (N, H, W, 3) uint8 of these steps; None for no pictures."""
        ...


@rule(
    version=1,
    packages=("numpy",),
    memory_gb=2.0,
    tolerance=TOLERANCE,
    runs={"first": "policy", "second": "policy", "bundle": "primitive", "twin": "primitive", "terms": ""},
)
def better(  # noqa: PLR0913 - one argument per input
    ctx: Context[BetterBackend],
    bundle: TaskBundle,
    first: Checkpoint,
    second: Checkpoint,
    view: View | None = None,
    views: Collection[View] | None = None,
    cell: Cell | None = None,
    twin: TaskBundle | None = None,
    terms: Collection[TermSpec] | None = None,
    *,
    options: BetterOptions,
) -> Compared:
    """Return the trials of two policies on the same starts, with start poses in the base frame [m].

    After every start, the starts that only one policy solved are tested by bets (`evaluate.paired`), and the trials end
    once one policy is the better one. If neither is, this happens with a probability of at most `alpha`, although the
    results decide when to stop. `view`, `cell`, `twin` and `terms` are those of `evaluate.rollouts`. Trials of an
    interrupted build are kept.
    """
    if twin is not None:
        same_task(ctx, twin, bundle)
    checkpoints, added, cameras = {"first": first, "second": second}, listed(terms), given(view, views)
    labels = _labels(ctx, checkpoints, options)
    records = {slot: Record(bundle, "exact" if cell is None else "tracked", added, stopped=True) for slot in labels}
    for each in checkpoints.values():
        contracts.check(each.contract, bundle, views=cameras, terms=added)

    def make(left: list[tuple[str, int]]) -> Iterator[Attempt]:
        made: Iterator[Attempt] = ctx.backend.better(
            ctx, bundle, checkpoints, cameras, cell, twin, left, added, ctx.backend_options
        )
        return made

    cases = [(slot, seed) for seed in seeds(options.seed, options.trials) for slot in labels]
    after = _run(ctx, records, resumed(ctx, cases, make), options)
    for slot, record in records.items():
        close(ctx, record, labels[slot])
        show(ctx, record, first_of(cameras), options.strip_frames)
    _say(ctx, records, labels, after)
    parts = {
        slot: record.trials(
            "policy",
            label=labels[slot],
            source=checkpoints[slot],
            algorithm=checkpoints[slot].contract.algorithm,
        )
        for slot, record in records.items()
    }
    return Compared(**parts, decided=after)


def _run(ctx: Context, records: dict[str, Record], made: Iterator[Attempt], options: BetterOptions) -> int | None:
    """Record attempts, of both policies in turn, until it is decided; the number of starts, None if it stays open."""
    for done, attempts in enumerate(zip(made, made, strict=True), 1):
        for record, attempt in zip(records.values(), attempts, strict=True):
            record.add(attempt)
        one, other = ([trial.success for trial in record.items] for record in records.values())
        ctx.progress(done, options.trials, f"{sum(one)} against {sum(other)}")
        if decided(one, other, options.alpha) is not None:
            return len(one)
    return None


def _labels(ctx: Context, checkpoints: Mapping[str, Checkpoint], options: BetterOptions) -> dict[str, str]:
    given = {"first": options.first_label, "second": options.second_label}
    found = {slot: given[slot] or policy_label(each.contract) for slot, each in checkpoints.items()}
    ctx.check(
        found["first"] != found["second"],
        f"both policies are called `{found['first']}`",
        hint="set `first_label` or `second_label`",
    )
    return found


def _say(ctx: Context, records: dict[str, Record], labels: dict[str, str], after: int | None) -> None:
    rates = {slot: record.rate for slot, record in records.items()}
    told = " against ".join(f"{labels[slot]} {rate.successes}/{rate.trials}" for slot, rate in rates.items())
    if after is None:
        ctx.say(f"open after {rates['first'].trials} starts: {told}")
    else:
        ctx.metric("decided after", after, "starts")
        better = max(rates, key=lambda slot: rates[slot].successes)
        ctx.say(f"{labels[better]} is better, known after {after} starts: {told}")

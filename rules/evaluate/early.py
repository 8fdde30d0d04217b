"""evaluate.early: how success in the twin grew during a training, and the weights to go on with."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Literal, Protocol

import numpy as np
from pydantic import Field

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.tasks.policy import Checkpoint, EarlyTrials
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.artifacts.tasks.trials import Attempt
from dextera_build.learning import curve_picture
from dextera_build.policy import contract as contracts
from dextera_build.policy.added import listed
from dextera_build.policy.cameras import given
from dextera_build.rule import ROUNDING, Context, Options, Tolerance, rule
from dextera_build.sim.runtime.seeds import seed_of
from dextera_build.statistics import Rate

from .attempts import resumed
from .protocol import Record

Case = tuple[int, int]
"""Optimiser step of a snapshot, and seed of a start."""


class EarlyOptions(Options):
    """Options of evaluate.early."""

    trials: int = Field(10, ge=1)
    """Starts of each snapshot, the same for all; none of them is a start of `evaluate.rollouts`."""
    seed: int = Field(0, ge=0)
    """Seed of the starts."""
    choose: Literal["last", "best"] = "last"
    """Weights of the result: those of the end of the training, or of the snapshot that succeeded most often; among
    equal ones the one with the greatest progress, then the latest."""


class EarlyBackend(Protocol):
    """Interface of a backend of evaluate.early."""

    def attempts(
        self,
        ctx: Context,
        bundle: TaskBundle,
        snapshots: Mapping[int, Checkpoint],
        views: Mapping[str, View],
        cases: list[Case],
        terms: tuple[TermSpec, ...],
        options: Any,
    ) -> Iterator[Attempt]:
        """One attempt per case, in order, each independent of the earlier ones."""
        ...


@rule(
    version=1,
    packages=("numpy",),
    memory_gb=2.0,
    tolerance=Tolerance({"": ROUNDING, "early": np.inf, "weights": np.inf}, metrics={"success": 100.0}),
    runs={"checkpoint": "policy", "bundle": "primitive", "terms": ""},
)
def early(
    ctx: Context[EarlyBackend],
    bundle: TaskBundle,
    checkpoint: Checkpoint,
    view: View | None = None,
    views: Collection[View] | None = None,
    terms: Collection[TermSpec] | None = None,
    *,
    options: EarlyOptions,
) -> Checkpoint:
    """Return the checkpoint with the trials of its snapshots, and without these.

    Every snapshot, and the end of the training, is tried from the same starts, which `evaluate.rollouts` never has with
    any seed: a success that is reported is not the one that weights were chosen by. Few trials tell when a training
    begins to succeed, not which of two good snapshots is better. Trials of an interrupted build are kept.
    """
    added, cameras = listed(terms), given(view, views)
    contracts.check(checkpoint.contract, bundle, views=cameras, terms=added)
    if not checkpoint.snapshots:
        ctx.fail("the checkpoint holds no snapshot", hint="`snapshot_every: 500` in the node that trained it")
    snapshots = _snapshots(checkpoint)
    seeds = [seed_of("early", options.seed, number) for number in range(options.trials)]
    cases = [(step, seed) for step in snapshots for seed in seeds]

    def make(left: list[Case]) -> Iterator[Attempt]:
        made: Iterator[Attempt] = ctx.backend.attempts(
            ctx, bundle, snapshots, cameras, left, added, ctx.backend_options
        )
        return made

    records = {step: Record(bundle) for step in snapshots}
    for done, ((step, _), attempt) in enumerate(zip(cases, resumed(ctx, cases, make), strict=True), 1):
        records[step].add(attempt)
        ctx.progress(done, len(cases), f"step {step:,}: {records[step].rate.successes} succeeded")
    found = _found(records, options.choose)
    ctx.check(found.trials > 0, "no trial came about", hint="make the ranges of `reset` smaller")
    _report(ctx, found)
    return snapshots[found.chosen].model_copy(update={"early": found})


def _snapshots(checkpoint: Checkpoint) -> dict[int, Checkpoint]:
    """Step -> the checkpoint with the weights after it, ascending; the end of the training last."""
    plain = checkpoint.model_copy(update={"snapshots": {}})
    steps = sorted(map(int, checkpoint.snapshots))
    found = {step: plain.model_copy(update={"weights": checkpoint.snapshots[str(step)]}) for step in steps}
    last = int(checkpoint.steps[-1]) if len(checkpoint.steps) else steps[-1] + 1
    return found | {last: plain}


def _found(records: Mapping[int, Record], choose: Literal["last", "best"]) -> EarlyTrials:
    rates = {step: (record.rate.successes, record.progress.value, step) for step, record in records.items()}
    return EarlyTrials(
        steps=tuple(records),
        successes=tuple(int(successes) for successes, _, _ in rates.values()),
        progress=tuple(float(progress) for _, progress, _ in rates.values()),
        trials=min(record.rate.trials for record in records.values()),
        chosen=max(rates.values())[2] if choose == "best" else max(records),
    )


def _report(ctx: Context[EarlyBackend], found: EarlyTrials) -> None:
    steps = np.array(found.steps)
    rates = [Rate(successes, found.trials) for successes in found.successes]
    low, high = np.array([rate.interval() for rate in rates]).T
    curves = {"success": np.array([rate.value for rate in rates]), "95 %, from": low, "to": high}
    ctx.preview(
        curve_picture.draw({name: (steps, each) for name, each in curves.items()}, "success", logarithmic=False),
        f"success in the twin during the training, {found.trials} trials each",
    )
    ctx.metric("success", 100 * curves["success"][found.steps.index(found.chosen)], "%")
    told = ", ".join(f"{step:,}: {count}" for step, count in zip(found.steps, found.successes, strict=True))
    ctx.say(f"successes of {found.trials} after steps {told}; the weights are those of step {found.chosen:,}")

"""evaluate.rollouts: run a policy on a task from many starts."""

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
from dextera_build.artifacts.tasks.trials import Attempt, Trials
from dextera_build.policy import contract as contracts
from dextera_build.policy.added import listed
from dextera_build.policy.cameras import given
from dextera_build.rule import Context, Options, rule

from .attempts import resumed
from .protocol import TOLERANCE, Record, close, policy_label, same_task, seeds
from .strip import first_of, show


class RolloutsOptions(Options):
    """Options of evaluate.rollouts."""

    trials: int = Field(100, ge=1)
    """Number of starts."""
    seed: int = Field(0, ge=0)
    """Seed of the starts; use the same for all compared policies."""
    label: str = ""
    """Name of the policy in tables; empty: its algorithm, `ACT`, or `ACT image` for an image policy."""
    strip_frames: int = Field(6, ge=2)
    """Pictures in each film strip."""


class RolloutsBackend(Protocol):
    """Interface of a backend of evaluate.rollouts."""

    def rollouts(
        self,
        ctx: Context,
        bundle: TaskBundle,
        checkpoint: Checkpoint,
        views: Mapping[str, View],
        cell: Cell | None,
        twin: TaskBundle | None,
        seeds: list[int],
        terms: tuple[TermSpec, ...],
        options: Any,
    ) -> Iterator[Attempt]:
        """One attempt per seed, in order, each independent of the earlier ones."""
        ...

    def stills(
        self, ctx: Context, bundle: TaskBundle, episode: Episode, rows: np.ndarray, view: View | None, options: Any
    ) -> np.ndarray | None:
        """Pictures (N, H, W, 3) uint8 of these steps; None for no pictures."""
        ...


@rule(
    version=3,
    packages=("numpy",),
    memory_gb=2.0,
    tolerance=TOLERANCE,
    runs={"checkpoint": "policy", "bundle": "primitive", "twin": "primitive", "terms": ""},
)
def rollouts(
    ctx: Context[RolloutsBackend],
    bundle: TaskBundle,
    checkpoint: Checkpoint,
    view: View | None = None,
    views: Collection[View] | None = None,
    cell: Cell | None = None,
    twin: TaskBundle | None = None,
    terms: Collection[TermSpec] | None = None,
    *,
    options: RolloutsOptions,
) -> Trials:
    """Return the policy's trials in the bundle's world, with start poses in the base frame [m].

    The loop is closed: at every control period the policy gets a deployable observation and returns joint targets. A
    policy that returns no usable action fails that trial only. A state policy ignores `view`; film strips use it. With
    a `cell`, poses and joints of objects come from its tracker instead of the simulator, and a trial whose object is
    not found beforehand fails; success is always judged by the true state. With `twin`, the task in the twin, a trial
    with a cell is also judged by the measured state. Trials of an interrupted build are kept.
    """
    if twin is not None:
        same_task(ctx, twin, bundle)
    added, cameras = listed(terms), given(view, views)
    contracts.check(checkpoint.contract, bundle, views=cameras, terms=added)
    record = Record(bundle, "exact" if cell is None else "tracked", added)

    def make(left: list[int]) -> Iterator[Attempt]:
        made: Iterator[Attempt] = ctx.backend.rollouts(
            ctx, bundle, checkpoint, cameras, cell, twin, left, added, ctx.backend_options
        )
        return made

    for done, attempt in enumerate(resumed(ctx, seeds(options.seed, options.trials), make), 1):
        record.add(attempt)
        ctx.progress(done, options.trials, f"{record.rate.successes} succeeded")
    close(ctx, record)
    show(ctx, record, first_of(cameras), options.strip_frames)
    label = options.label or policy_label(checkpoint.contract)
    return record.trials("policy", label=label, source=checkpoint, algorithm=checkpoint.contract.algorithm)

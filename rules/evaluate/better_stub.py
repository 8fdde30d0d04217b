"""evaluate.better without simulator and networks: nine of ten trials succeed for both policies."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from dextera_build.artifacts.robots.cell import Cell
from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.artifacts.tasks.trials import Attempt
from dextera_build.rule import Backend, Context, Options

from .rollouts_stub import rollouts
from .rollouts_stub import stills as stills

BACKEND = Backend(summary="no simulation: nine of ten tries succeed", profiles=("stub",))


def better(
    ctx: Context,
    bundle: TaskBundle,
    checkpoints: Mapping[str, Checkpoint],
    views: Mapping[str, View],
    cell: Cell | None,
    twin: TaskBundle | None,
    cases: list[tuple[str, int]],
    terms: tuple[TermSpec, ...],
    options: Options,
) -> Iterator[Attempt]:
    """One attempt per case, in order."""
    for slot, seed in cases:
        yield from rollouts(ctx, bundle, checkpoints[slot], views, cell, twin, [seed], terms, options)

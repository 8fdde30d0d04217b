"""evaluate.operator_trials: the scripted operator of a twin performs its task in another world."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from pydantic import Field

from dextera_build.artifacts.robots.cell import Cell
from dextera_build.artifacts.tasks.episode import Episode
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.artifacts.tasks.trials import Attempt, Operated
from dextera_build.rule import Context, Options, rule

from .attempts import resumed
from .protocol import TOLERANCE, Record, close, same_task, seeds
from .strip import show


class OperatorTrialsOptions(Options):
    """Options of evaluate.operator_trials."""

    trials: int = Field(20, ge=1)
    """Number of starts in each world."""
    twin_trials: int = Field(0, ge=0)
    """Number of starts in the twin, the same ones first; 0: `trials`. More of them tell `evaluate.transfer` more."""
    seed: int = Field(0, ge=0)
    """Seed of the starts; the same as for policies."""
    label: str = "operator"
    """Name of the operator in tables."""
    strip_frames: int = Field(6, ge=2)
    """Pictures in each film strip."""


@dataclass(frozen=True)
class Case:
    """One trial to run."""

    world: TaskBundle
    """The world of the trial."""
    cell: Cell | None
    """The cell that measures poses; None: poses are exact."""
    seed: int
    """Seed of the start."""


class OperatorTrialsBackend(Protocol):
    """Interface of a backend of evaluate.operator_trials."""

    def operated(self, ctx: Context, twin: TaskBundle, cases: list[Case], options: Any) -> Iterator[Attempt]:
        """One attempt per case, in order, each independent of the earlier ones."""
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
    runs={"twin": ("primitive", "script"), "world": "primitive"},
)
def operator_trials(
    ctx: Context[OperatorTrialsBackend],
    twin: TaskBundle,
    world: TaskBundle,
    view: View | None = None,
    cell: Cell | None = None,
    *,
    options: OperatorTrialsOptions | None = None,
) -> Operated:
    """Return trials of the scripted operator rehearsed in `twin`: there, in `world`, and through a cell [m].

    At every start it plans in the twin from the measured poses, and its commands are converted to joint targets by the
    twin's inverse kinematics. With a `cell`, poses and joints of objects come from its tracker and targets pass its
    guard, as in `evaluate.rollouts`: a start whose object is not found is a failure, success is judged by the true
    state, and also by the measured one for comparison. An operator that never succeeded in rehearsal fails every trial.
    Trials of an interrupted build are kept.
    """
    options = options or OperatorTrialsOptions()
    ctx.check(
        twin.kind == "twin",
        f"the operator practises in the twin, but the input `twin` is a {twin.kind} world",
        hint="give the twin's task bundle as `twin`, the other world's as `world`",
    )
    same_task(ctx, twin, world)
    ways: dict[str, tuple[TaskBundle, Cell | None]] = {"twin": (twin, None), "world": (world, None)}
    if cell is not None:
        ways["cell"] = (world, cell)
    records = {name: Record(where, "tracked" if through else "exact") for name, (where, through) in ways.items()}
    counts = {"twin": options.twin_trials or options.trials}
    cases = [
        (name, Case(where, through, seed))
        for name, (where, through) in ways.items()
        for seed in seeds(options.seed, counts.get(name, options.trials))
    ]

    def make(left: list[tuple[str, Case]]) -> Iterator[Attempt]:
        made: Iterator[Attempt] = ctx.backend.operated(ctx, twin, [case for _, case in left], ctx.backend_options)
        return made

    for (name, _), attempt in zip(cases, resumed(ctx, cases, make), strict=True):
        record = records[name]
        record.add(attempt)
        done = sum(len(each.items) + each.excluded.total() for each in records.values())
        ctx.progress(done, len(cases), f"{name}: {record.rate}")
    for record in records.values():
        close(ctx, record)
        show(ctx, record, view, options.strip_frames)
    ctx.say(", ".join(f"{record.rate} in {told(record)}" for record in records.values()))
    made = {
        name: record.trials("policy", label=options.label, source=twin, algorithm="script")
        for name, record in records.items()
    }
    return Operated(**made)


def told(record: Record) -> str:
    """`the twin`, `the reference`, `the reference, poses tracked`."""
    return f"the {record.bundle.kind}" + (", poses tracked" if record.poses == "tracked" else "")

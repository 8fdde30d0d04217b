"""evaluate.expert: success rate of the scripted operator, and the return of random actions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from pydantic import NonNegativeInt, PositiveInt

from dextera_build.artifacts.table import Column, Table
from dextera_build.artifacts.tasks.episode import Episode, Episodes
from dextera_build.artifacts.tasks.reasons import spelled
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.rule import Context, Options, rule
from dextera_build.statistics import wilson

from .protocol import robot_name


class ExpertOptions(Options):
    """Options of evaluate.expert."""

    measured: PositiveInt = 10
    """Number of episodes whose returns are measured, of the operator and of a random policy from the same starts."""
    seed: NonNegativeInt = 0
    """Seed of the random policy."""


class ExpertBackend(Protocol):
    """Interface of a backend of evaluate.expert."""

    def returns(
        self, ctx: Context, bundle: TaskBundle, episodes: Sequence[Episode], seed: int, options: Any
    ) -> tuple[np.ndarray, np.ndarray]:
        """Returns (N,) of the episodes, and of random actions from their starts."""
        ...


@rule(version=1, packages=("numpy",), runs={"bundle": "primitive"})
def expert(
    ctx: Context[ExpertBackend], bundle: TaskBundle, episodes: Episodes, *, options: ExpertOptions | None = None
) -> Table:
    """Return one row: success rate [%] over all attempts with its 95 % Wilson interval, returns, reasons of failures.

    A return is the sum of the task's rewards over an episode, see `dextera_build.sim.primitives.stages`. The random
    policy draws joint targets uniformly within their limits once per control period.
    """
    options = options or ExpertOptions()
    done, count = len(episodes.items), episodes.attempts
    low, high = wilson(done, count)
    everything = {**episodes.items, **episodes.failures}
    some = [everything[name] for name in sorted(everything)][: options.measured]
    own, random = ctx.backend.returns(ctx, bundle, some, options.seed, ctx.backend_options)
    ctx.metric("success", 100 * done / max(count, 1), "%")
    ctx.metric("return of the expert", float(own.mean()), "")
    ctx.metric("return of random actions", float(random.mean()), "")
    ctx.say(
        f"{done} of {count}, {100 * low:.0f}-{100 * high:.0f} %, return {own.mean():.1f}, random {random.mean():.1f}"
    )
    row = (
        bundle.task.name,
        robot_name(bundle),
        bundle.task.primitive,
        count,
        *(float(value) for value in (100 * done / max(count, 1), 100 * low, 100 * high, own.mean(), random.mean())),
        spelled(episodes.reasons, most=len(episodes.failures)),
    )
    rates = ("success", "low", "high")
    return Table(
        title="The scripted operator in the twin",
        columns=(
            *(Column(name=name) for name in ("task", "robot", "primitive", "attempts")),
            *(Column(name=name, unit="%", digits=0) for name in rates),
            *(Column(name=name, digits=2) for name in ("return", "random return")),
            Column(name="failures"),
        ),
        rows=(row,),
        notes=(
            "Attempts from starts that no rehearsal has seen; low and high are the 95 % Wilson interval.",
            f"Returns are means over at most {options.measured} attempts and random actions from the same starts.",
        ),
    )

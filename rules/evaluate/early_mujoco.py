"""evaluate.early in MuJoCo."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import groupby
from operator import itemgetter
from typing import TYPE_CHECKING

from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.artifacts.tasks.trials import Attempt
from dextera_build.rule import Backend, Context, Options

from .trying import trying

if TYPE_CHECKING:
    from .early import Case

BACKEND = Backend(
    summary="MuJoCo; networks by torch on one thread",
    profiles=("cpu",),
    packages=("mujoco", "torch", "safetensors"),
    extra="learn",
)


def attempts(
    ctx: Context,
    bundle: TaskBundle,
    snapshots: Mapping[int, Checkpoint],
    views: Mapping[str, View],
    cases: list[Case],
    terms: tuple[TermSpec, ...],
    options: Options,
) -> Iterator[Attempt]:
    """One attempt per case, in order."""
    for step, group in groupby(cases, itemgetter(0)):
        with trying(ctx, bundle, {"checkpoint": snapshots[step]}, views, None, None, terms) as attempt:
            for _, seed in group:
                yield attempt("checkpoint", seed)

"""evaluate.rollouts in MuJoCo."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from dextera_build.artifacts.robots.cell import Cell
from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.artifacts.tasks.trials import Attempt
from dextera_build.rule import Backend, Context, Options

from .filmed import stills as stills
from .trying import trying

BACKEND = Backend(
    summary="MuJoCo; networks by torch on one thread; with a cell, the tracker of `align.track`",
    profiles=("cpu",),
    packages=("mujoco", "torch", "safetensors", "open3d", "opencv-python-headless", "scipy"),
    extra="learn",
)


def rollouts(
    ctx: Context,
    bundle: TaskBundle,
    checkpoint: Checkpoint,
    views: Mapping[str, View],
    cell: Cell | None,
    twin: TaskBundle | None,
    seeds: list[int],
    terms: tuple[TermSpec, ...],
    options: Options,
) -> Iterator[Attempt]:
    """One attempt per seed, in order."""
    with trying(ctx, bundle, {"checkpoint": checkpoint}, views, cell, twin, terms) as attempt:
        for seed in seeds:
            yield attempt("checkpoint", seed)

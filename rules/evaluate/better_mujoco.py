"""evaluate.better in MuJoCo."""

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
    with trying(ctx, bundle, checkpoints, views, cell, twin, terms) as attempt:
        for slot, seed in cases:
            yield attempt(slot, seed)

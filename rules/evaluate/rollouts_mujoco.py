"""evaluate.rollouts in MuJoCo."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import nullcontext

from dextera_build.artifacts.robots.cell import Cell
from dextera_build.artifacts.tasks.policy import Checkpoint, PolicyContract
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.artifacts.tasks.trials import Attempt
from dextera_build.policy.added import of_specs
from dextera_build.policy.running import Runner
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.observe import pictures
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.policies import load
from dextera_build.sim.runtime.tracked_cell import TrackedCell

from .attempted import attempted
from .filmed import stills as stills

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
    view: View | None,
    cell: Cell | None,
    twin: TaskBundle | None,
    seeds: list[int],
    terms: tuple[TermSpec, ...],
    options: Options,
) -> Iterator[Attempt]:
    """One attempt per seed, in order."""
    runner: Runner = ctx.companion("checkpoint", checkpoint.contract.algorithm, Runner)
    policy = load(runner, checkpoint, bundle, view, terms=terms)
    environment = Environment(bundle, terms=of_specs(terms, ctx.companion))
    sees = view is not None and any(channel.name == "rgb" for channel in checkpoint.contract.inputs)
    opened = pictures.live(environment, view) if view and sees else nullcontext()
    names = objects_of(checkpoint.contract, bundle)
    tracked = nullcontext() if cell is None else TrackedCell(environment, cell, names, twin)
    with opened as look, tracked as watching:
        for seed in seeds:
            yield attempted(environment, policy, seed, watching, look)


def objects_of(contract: PolicyContract, bundle: TaskBundle) -> set[str]:
    """Objects whose poses or joints are inputs of a policy."""
    taken = {channel.name: set(channel.names) for channel in contract.inputs}
    joints = taken.get("displacement", set())
    return taken.get("objects", set()) | {name for name, thing in bundle.objects.items() if joints & {*thing.joints}}

"""Trials of one or several policies in one world in MuJoCo."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext

from dextera_build.artifacts.robots.cell import Cell
from dextera_build.artifacts.tasks.policy import Checkpoint, PolicyContract
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.artifacts.tasks.trials import Attempt
from dextera_build.policy import cameras
from dextera_build.policy.added import of_specs
from dextera_build.policy.running import Runner
from dextera_build.rule import Context
from dextera_build.sim.observe import pictures
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.policies import load
from dextera_build.sim.runtime.tracked_cell import TrackedCell

from .simulated_attempt import simulated


@contextmanager
def trying(
    ctx: Context,
    bundle: TaskBundle,
    checkpoints: Mapping[str, Checkpoint],
    views: Mapping[str, View],
    cell: Cell | None,
    twin: TaskBundle | None,
    terms: tuple[TermSpec, ...],
) -> Iterator[Callable[[str, int], Attempt]]:
    """Gives a function that makes the attempt of a policy, by its input, from the start of a seed.

    Args:
        ctx: Gives the code that runs the checkpoints.
        bundle: The world.
        checkpoints: Input of the rule -> policy.
        views: Cameras of policies on pictures.
        cell: Measures the world; None: poses are exact.
        twin: The task in the twin, in which measurements are judged, too.
        terms: Recorded terms that do not come with dxb.
    """
    policies = {
        slot: load(ctx.companion(slot, each.contract.algorithm, Runner), each, bundle, views, terms=terms)
        for slot, each in checkpoints.items()
    }
    environment = Environment(bundle, terms=of_specs(terms, ctx.companion))
    seeing = {slot for slot, each in checkpoints.items() if each.contract.sees}
    seen = [channel.name for each in checkpoints.values() for channel in each.contract.seen]
    outputs, used = {cameras.term_of(name) for name in seen}, {cameras.camera_of(name) for name in seen}
    looking = {name: view for name, view in views.items() if name in used}
    opened = pictures.live(environment, looking, outputs) if looking else nullcontext()
    names = set[str]().union(*(objects_of(each.contract, bundle) for each in checkpoints.values()))
    tracked = nullcontext() if cell is None else TrackedCell(environment, cell, names, twin)
    with opened as look, tracked as watching:

        def attempt(slot: str, seed: int) -> Attempt:
            return simulated(environment, policies[slot], seed, watching, look if slot in seeing else None)

        yield attempt


def objects_of(contract: PolicyContract, bundle: TaskBundle) -> set[str]:
    """Objects whose poses or joints are inputs of a policy."""
    taken = {channel.name: set(channel.names) for channel in contract.inputs}
    joints = taken.get("displacement", set())
    return taken.get("objects", set()) | {name for name, thing in bundle.objects.items() if joints & {*thing.joints}}

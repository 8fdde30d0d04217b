"""reference.episodes: episodes of a task in the world that replaces hardware, recorded as hardware gives them."""

from __future__ import annotations

import math
from typing import Any, Protocol

from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt

from dextera_build.artifacts.robots.cell import Cell
from dextera_build.artifacts.tasks.episode import Episodes, Shard
from dextera_build.artifacts.tasks.reasons import spelled
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.policy.contract import check_data
from dextera_build.rule import Context, Options, Tolerance, rule


class EpisodesOptions(Options):
    """Options of reference.episodes."""

    tries: PositiveInt = 3
    """Maximum number of starts per episode, after which fewer episodes are returned."""
    rehearsals: PositiveInt = 5
    """Maximum number of syntheses in the twin per start until one succeeds."""
    nearest: PositiveInt = 5
    """Number of demonstrations with the most similar object pose from which one is drawn."""
    lag_m: PositiveFloat = 0.02
    """Syntheses in which joint limits keep the palm farther than this from its command are discarded [m]."""
    press_n: NonNegativeFloat = 2.0
    """Syntheses with an unintended contact above this force are discarded [N]."""
    linger_s: float = Field(1.0, ge=0)
    """Time to hold the last joint targets after the trajectory [s]."""


class EpisodesBackend(Protocol):
    """Interface of a backend of reference.episodes."""

    def record(
        self,
        ctx: Context,
        twin: TaskBundle,
        world: TaskBundle,
        sources: Episodes,
        cell: Cell,
        shard: Shard,
        common: EpisodesOptions,
        options: Any,
    ) -> Episodes:
        """Attempt episodes until the shard is full, or the starts are used up."""
        ...


# Contacts amplify rounding differences, and an attempt may end differently on another processor.
@rule(
    version=1,
    memory_gb=2.0,
    tolerance=Tolerance({"items": math.inf, "failures": math.inf, "attempts": math.inf}, metrics={"yield": 0.4}),
    runs={"twin": "primitive", "world": "primitive"},
)
def episodes(
    ctx: Context[EpisodesBackend],
    twin: TaskBundle,
    world: TaskBundle,
    sources: Episodes,
    cell: Cell,
    shard: Shard,
    *,
    options: EpisodesOptions | None = None,
) -> Episodes:
    """Return the shard's episodes in a cell, in the robot's base frame [m, rad], and failed attempts with reasons.

    At every start the cell's tracker measures the objects, `sources` are adapted to them in the twin (Eq. 4, without
    noise) until a rehearsal succeeds, and its joint targets pass the cell's guard. Joints are recorded from encoders,
    poses from the tracker, placed by the calibration; forces are not known. Success is that of the true state. If too
    few attempts succeed, there are fewer episodes.

    Raises:
        RuleError: The two worlds or the demonstrations do not hold the same task.
    """
    options = options or EpisodesOptions()
    ctx.check(
        (twin.kind, twin.task, list(twin.objects)) == ("twin", world.task, list(world.objects)),
        f"`twin` does not hold the task `{world.task.name}` of the world",
        twin=f"{twin.kind}, {twin.task.name} with {', '.join(twin.objects)}",
        hint="give the twin's task bundle as `twin`, and as `world` the one that was made from it",
    )
    check_data(twin, sources)
    ctx.check(bool(sources.items), "no demonstrations were given", hint="look at `dxb log` of the demonstrations")
    found: Episodes = ctx.backend.record(ctx, twin, world, sources, cell, shard, options, ctx.backend_options)
    done = len(found.items)
    ctx.metric("yield", done / max(1, found.attempts))
    ctx.say(f"{done} of {shard.count} episodes in the {world.kind} world from {found.attempts} attempts")
    if done < shard.count:
        ctx.warn(f"only {done} of {shard.count} episodes came out: {spelled(found.reasons, most=5)}")
    for reason, count in found.reasons.items():
        ctx.log(f"{count} x {reason}")
    return found

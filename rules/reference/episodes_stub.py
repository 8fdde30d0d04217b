"""reference.episodes without a simulator: every attempt succeeds."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dextera_build.artifacts.robots.cell import Cell
from dextera_build.artifacts.tasks.episode import Episodes, Shard
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.policy import layout
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.runtime.fake_trials import fake_trial

if TYPE_CHECKING:
    from .episodes import EpisodesOptions

BACKEND = Backend(summary="no simulation: every attempt succeeds", profiles=("stub",))


def record(
    ctx: Context,
    twin: TaskBundle,
    world: TaskBundle,
    sources: Episodes,
    cell: Cell,
    shard: Shard,
    common: EpisodesOptions,
    options: Options,
) -> Episodes:
    """Return the shard's number of episodes."""
    items = {
        f"{number:05d}": fake_trial(world, shard.seed + number, "replay", success=True)
        for number in range(shard.first, shard.first + shard.count)
    }
    return layout.gathered(world, items, {}, shard.count)

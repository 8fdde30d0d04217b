"""reference.episodes in MuJoCo."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from dextera_build.artifacts.robots.cell import Cell
from dextera_build.artifacts.tasks.episode import Episode, Episodes, Shard, Start
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.policy import layout
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.experts import synthesis
from dextera_build.sim.experts.drive import Driver
from dextera_build.sim.experts.filters import SETTLE_RAD_S, SYNTHESIS
from dextera_build.sim.experts.synthesis import Manner
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.recorder import Recorder
from dextera_build.sim.runtime.replay import Replay
from dextera_build.sim.runtime.seeds import seed_of
from dextera_build.sim.runtime.tracked_cell import TrackedCell

if TYPE_CHECKING:
    from .episodes import EpisodesOptions

BACKEND = Backend(
    summary="MuJoCo; inverse kinematics by mink; the tracker of `align.track`",
    profiles=("cpu",),
    packages=("mujoco", "mink", "daqp", "open3d", "opencv-python-headless", "scipy"),
    extra="twin",
)


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
    """Attempt episodes until the shard is full, or the starts are used up."""
    driver, there = Driver(Environment(twin), SETTLE_RAD_S), Environment(world)
    filters = replace(SYNTHESIS, lag_m=common.lag_m, press_n=common.press_n)
    manner = Manner(filters=filters, nearest=common.nearest)

    def synthesise(start: Start, seed: int) -> Episode:
        return synthesis.synthesise(driver, sources, start, seed, manner)

    items: dict[str, Episode] = {}
    failures: dict[str, Episode] = {}
    attempts = 0
    with TrackedCell(there, cell, world.objects, twin) as watching:
        replay = Replay(
            driver.environment,
            there,
            synthesise,
            tries=common.rehearsals,
            cell=watching,
            linger_s=common.linger_s,
            records=True,
        )
        while len(items) < shard.count and attempts < common.tries * shard.count:
            done = replay.attempt(seed_of("reference", shard.seed, shard.first, attempts))
            attempts += 1
            # An attempt without a rehearsal that succeeds is an episode without a step.
            missed = Recorder(there, measured=True)
            episode = done.episode or missed.episode("replay", success=False, reason=done.reason)
            if episode.success:
                items[f"{shard.first + len(items):05d}"] = episode
            else:
                failures[f"{shard.first:05d}-{attempts:03d}"] = episode
            ctx.progress(len(items), shard.count, f"{attempts} attempts")
    made = layout.gathered(world, items, failures, attempts)
    return made.model_copy(update={"tip_names": ()})

"""evaluate.replay in MuJoCo."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.robots.cell import Cell
from dextera_build.artifacts.tasks.episode import Episode, Episodes, Start
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.artifacts.tasks.trials import Attempt
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.experts import synthesis
from dextera_build.sim.experts.drive import Driver
from dextera_build.sim.experts.filters import SETTLE_RAD_S, SYNTHESIS
from dextera_build.sim.experts.synthesis import Manner
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.reconstruction import Tracker
from dextera_build.sim.runtime.replay import Replay
from dextera_build.sim.runtime.tracked_cell import TrackedCell

from .filmed import stills as stills

if TYPE_CHECKING:
    from .replay import ReplayOptions

BACKEND = Backend(
    summary="MuJoCo; inverse kinematics by mink; with a cell, the tracker of `align.track`",
    profiles=("cpu",),
    packages=("mujoco", "mink", "daqp", "open3d", "opencv-python-headless", "scipy"),
    extra="twin",
)


def replays(
    ctx: Context,
    twin: TaskBundle,
    world: TaskBundle,
    sources: Episodes,
    cell: Cell | None,
    seeds: list[int],
    common: ReplayOptions,
    options: Options,
) -> Iterator[Attempt]:
    """One attempt per seed, in order."""
    driver = Driver(Environment(twin), SETTLE_RAD_S)
    filters = replace(SYNTHESIS, lag_m=common.lag_m, press_n=common.press_n)
    manner = Manner(filters=filters, nearest=common.nearest)

    def synthesise(start: Start, seed: int) -> Episode:
        return synthesis.synthesise(driver, sources, start, seed, manner)

    there = Environment(world)
    there.staged = True
    watched = nullcontext() if cell is None else TrackedCell(there, cell, world.objects)
    with watched as watching:
        replay = Replay(
            driver.environment,
            there,
            synthesise,
            tries=common.tries,
            tracker=Tracker(common.tracker_m, float(np.radians(common.tracker_deg))),
            cell=watching,
            linger_s=common.linger_s,
        )
        for seed in seeds:
            done = replay.attempt(seed)
            yield Attempt(
                seed=seed,
                episode=done.episode,
                placed=None if done.placed is None else done.placed.astype(np.float32),
                excluded=done.reason,
                stage=int(there.judge.stage[0]),
                rehearsal=done.rehearsal,
                sighting=None if watching is None or done.episode is None else watching.sighting,
            )

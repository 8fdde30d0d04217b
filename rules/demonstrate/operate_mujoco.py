"""demonstrate.operate with a scripted operator in MuJoCo."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.robots.hand_stream import HandStream
from dextera_build.artifacts.tasks.episode import Episode, Episodes
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.policy import layout
from dextera_build.policy.added import of_specs
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.experts import planning
from dextera_build.sim.experts.drive import Driver
from dextera_build.sim.experts.filters import Filters
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.seeds import seed_of

from .attempt_strips import attempt_strips

if TYPE_CHECKING:
    from .operate import OperateOptions

BACKEND = Backend(
    summary="a script: grasps and pushes from geometry, rehearsed in MuJoCo; inverse kinematics by mink",
    profiles=("cpu",),
    packages=("mujoco", "mink", "daqp"),
    extra="learn",
)


def operate(
    ctx: Context,
    bundle: TaskBundle,
    terms: tuple[TermSpec, ...],
    recording: HandStream | None,
    common: OperateOptions,
    options: Options,
) -> Episodes:
    """Attempt demonstrations until enough succeed or the attempts are used up."""
    if recording is not None:
        ctx.fail("the scripted operator follows no recording", hint="add `backend: hands`, or leave out `recording`")
    driver = Driver(Environment(bundle, terms=of_specs(terms, ctx.companion)))
    operator = planning.practise(driver, ctx.progress, anyway=common.attempts is not None, good=common.good)
    filters = Filters(lag_m=common.lag_m, press_n=common.press_n)
    items: dict[str, Episode] = {}
    failures: dict[str, Episode] = {}
    attempts = 0
    enough, most = common.most()
    while len(items) < enough and attempts < most:
        start = driver.environment.draw(seed_of("operate", common.seed, attempts))
        episode = driver.run(operator, start, origin="operator", filters=filters)
        (items if episode.success else failures)[f"{attempts:05d}"] = episode
        attempts += 1
        ctx.progress(attempts, most, f"{len(items)} succeeded")
    return layout.gathered(bundle, items, failures, attempts, terms)


def strips(ctx: Context, bundle: TaskBundle, episodes: Episodes, options: Options) -> list[tuple[str, np.ndarray]]:
    """Film strips of the first success and the first failure."""
    return attempt_strips(bundle, episodes)

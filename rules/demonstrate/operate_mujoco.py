"""demonstrate.operate with a scripted operator in MuJoCo."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.tasks.episode import Episode, Episodes
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.policy import layout
from dextera_build.policy.added import of_specs
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.experts import planning
from dextera_build.sim.experts.drive import Driver, Filters
from dextera_build.sim.render.stills import Stills
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.seeds import seed_of

from .film_strip import strip

if TYPE_CHECKING:
    from .operate import OperateOptions

BACKEND = Backend(
    summary="a script: grasps and pushes from geometry, rehearsed in MuJoCo; inverse kinematics by mink",
    profiles=("cpu",),
    packages=("mujoco", "mink", "daqp"),
    extra="learn",
)
SHOWN = 10
"""Pictures per strip."""


def operate(
    ctx: Context, bundle: TaskBundle, terms: tuple[TermSpec, ...], common: OperateOptions, options: Options
) -> Episodes:
    """Attempt demonstrations until enough succeed or the attempts are used up."""
    driver = Driver(Environment(bundle, terms=of_specs(terms, ctx.companion)))
    operator = planning.practise(driver, ctx.progress, anyway=common.attempts is not None)
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
    stills = Stills(bundle, None)
    shown = [("a demonstration", episode) for episode in list(episodes.items.values())[:1]]
    shown += [(f"failed: {episode.reason}", episode) for episode in list(episodes.failures.values())[:1]]
    pictures = []
    for caption, episode in shown:
        rows = np.linspace(0, max(0, len(episode.joints) - 1), SHOWN).round().astype(int)
        pictures.append((caption, strip(stills.at(episode, rows), SHOWN)))
    return pictures

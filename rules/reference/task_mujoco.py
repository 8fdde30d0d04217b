"""reference.task with MuJoCo."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.scenes.world import World
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.model.machine import machine_of
from dextera_build.sim.render import portrait
from dextera_build.sim.worlds import reference as builder

if TYPE_CHECKING:
    from .task import TaskOptions

BACKEND = Backend(
    summary="MuJoCo: the true things in the twin's place",
    profiles=("cpu",),
    packages=("mujoco",),
    extra="twin",
)


def build(ctx: Context, bundle: TaskBundle, world: World, common: TaskOptions, options: Options) -> TaskBundle:
    """Build the task in the reference world."""
    machine = machine_of(common)
    return builder.build(bundle, world, machine, contact_rate=common.contact_rate_rad_s, farthest_m=common.match_m)


def portraits(ctx: Context, bundle: TaskBundle, options: Options) -> list[tuple[str, np.ndarray]]:
    """Render the configuration of the photograph."""
    return portrait.at_home(bundle)

"""simulate.task with MuJoCo: compose the model and show starts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.model import compose as composer
from dextera_build.sim.primitives import base as primitives
from dextera_build.sim.primitives import within_reach
from dextera_build.sim.primitives.base import UnfitError
from dextera_build.sim.render.portrait import portrait
from dextera_build.sim.runtime.environment import Environment

if TYPE_CHECKING:
    from .task import TaskOptions

BACKEND = Backend(
    summary="MuJoCo: scene and robot in one MJCF",
    profiles=("cpu",),
    packages=("mujoco",),
    extra="twin",
)
RATE = 0.05
"""Largest difference of the rate from `control_hz`, as a fraction."""
SHOWN = 3
"""Number of starts shown."""


def fitted(
    ctx: Context, joints: Mapping[str, list[str]], common: TaskOptions, own: primitives.Options, options: Options
) -> tuple[TaskOptions, primitives.Options]:
    """Return `common` and `own` unchanged."""
    return common, own


def compose(ctx: Context, scene: Folder, robot: RobotModel, world_from_base: np.ndarray, options: Options) -> Folder:
    """Scene and robot as one MJCF."""
    return composer.with_robot(scene, robot, world_from_base)


def portraits(ctx: Context, bundle: TaskBundle, options: Options) -> list[tuple[str, np.ndarray]]:
    """Captions and pictures of the photograph's configuration and of some starts.

    Raises if the object or its target is farther away than the arms are long, if the simulation cannot keep the rate,
    and if no start can be drawn.
    """
    try:
        within_reach.check(bundle)
    except UnfitError as error:
        ctx.fail(error.message, hint=error.hint, **error.facts)
    environment = Environment(bundle)
    _check_rate(ctx, environment)
    found = [("as photographed", portrait(environment.model, environment.data))]
    for seed in range(SHOWN):
        environment.reset(seed)
        found.append((f"start {seed}", portrait(environment.model, environment.data)))
    return found


def _check_rate(ctx: Context, environment: Environment) -> None:
    """Raise for a rate that whole simulation steps cannot keep."""
    asked, step_s = environment.task.control_hz, environment.model.opt.timestep
    steps = max(1.0, 1.0 / (asked * step_s))
    ctx.check(
        abs(environment.period_s * asked - 1.0) <= RATE,
        f"the simulation cannot keep `control_hz: {asked:g}`",
        steps=f"{1000 * step_s:g} ms each, {environment.substeps} of them are {1.0 / environment.period_s:.4g} Hz",
        hint=f"set `control_hz: {1.0 / (np.ceil(steps) * step_s):.4g}`",
    )

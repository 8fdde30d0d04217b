"""simulate.perturbed with MuJoCo."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.model.machine import machine_of
from dextera_build.sim.render import portrait
from dextera_build.sim.worlds import perturb

if TYPE_CHECKING:
    from .perturbed import PerturbedOptions

BACKEND = Backend(
    summary="MuJoCo: the twin's model, disturbed",
    profiles=("cpu",),
    packages=("mujoco",),
    extra="twin",
)


def build(
    ctx: Context, bundle: TaskBundle, common: PerturbedOptions, options: Options
) -> tuple[TaskBundle, dict[str, perturb.Factors]]:
    """Build the perturbed task and the scale factors of every object."""
    robot = machine_of(common)
    most = perturb.Disturbance(
        size_sigma=common.size_sigma,
        dynamics=common.dynamics,
        hinge_sigma=common.hinge_sigma,
        centre_m=common.centre_m,
        contact_sigma=common.contact_sigma,
    )
    return perturb.build(bundle, most, robot, common.sizes)


def portraits(ctx: Context, bundle: TaskBundle, options: Options) -> list[tuple[str, np.ndarray]]:
    """Render the configuration of the photograph."""
    return portrait.at_home(bundle)

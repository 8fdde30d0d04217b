"""simulate.perturbed with MuJoCo."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.task import TaskBundle
from dextera_build.rule import Backend
from dextera_build.sim.model.machine import machine_of
from dextera_build.sim.render import portrait
from dextera_build.sim.worlds import perturb

if TYPE_CHECKING:
    from .perturbed import PerturbedOptions

BACKEND = Backend(
    summary="MuJoCo: the twin's model, disturbed",
    profiles=("cpu", "gpu"),
    packages=("mujoco",),
    extra="twin",
)


def build(bundle: TaskBundle, options: PerturbedOptions) -> tuple[TaskBundle, dict[str, perturb.Factors]]:
    """Build the perturbed task and the scale factors of every object."""
    robot = machine_of(options)
    most = perturb.Disturbance(
        size_sigma=options.size_sigma,
        dynamics=options.dynamics,
        hinge_sigma=options.hinge_sigma,
        centre_m=options.centre_m,
        contact_sigma=options.contact_sigma,
    )
    return perturb.build(bundle, most, robot, options.sizes)


def portraits(bundle: TaskBundle) -> list[tuple[str, np.ndarray]]:
    """Render the configuration of the photograph."""
    return portrait.at_home(bundle)

"""simulate.perturbed with MuJoCo."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.task import TaskBundle
from dextera_build.rule import Backend
from dextera_build.sim import model as models
from dextera_build.sim import perturb
from dextera_build.sim.machine import Machine
from dextera_build.sim.portrait import portrait

if TYPE_CHECKING:
    from .perturbed import PerturbedOptions

BACKEND = Backend(
    summary="MuJoCo: the twin's model, disturbed",
    profiles=("cpu", "gpu"),
    packages=("mujoco",),
    extra="twin",
)


def build(bundle: TaskBundle, options: PerturbedOptions) -> tuple[TaskBundle, dict[str, perturb.Factors]]:
    """The disturbed task and the scale factors of every object."""
    robot = Machine(
        seed=options.seed,
        gain_spread=options.gain_spread,
        arm_friction=options.arm_friction,
        hand_friction=options.hand_friction,
        skin_spread=options.skin_spread,
        timestep_s=options.timestep_s,
        latency_s=options.latency_s,
    )
    most = perturb.Disturbance(
        size_sigma=options.size_sigma,
        dynamics=options.dynamics,
        hinge_sigma=options.hinge_sigma,
        centre_m=options.centre_m,
        contact_sigma=options.contact_sigma,
    )
    return perturb.build(bundle, most, robot, options.sizes)


def portraits(bundle: TaskBundle) -> list[tuple[str, np.ndarray]]:
    """The configuration of the photograph."""
    model = models.compile_folder(bundle.model)
    return [(bundle.kind, portrait(model, models.at_home(model)))]

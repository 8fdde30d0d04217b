"""align.dynamics without a simulation: nothing is identified."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from dextera_build.artifacts.tasks.dynamics import DynamicsEstimate, Estimate, ObjectDynamics
from dextera_build.artifacts.tasks.episode import Episode
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.policy.layout import embodiment
from dextera_build.rule import Backend, Context, Options

if TYPE_CHECKING:
    from .dynamics import DynamicsOptions

BACKEND = Backend(summary="nothing is identified", profiles=("stub",))


def estimate(
    ctx: Context, bundle: TaskBundle, episodes: Sequence[Episode], common: DynamicsOptions, options: Options
) -> DynamicsEstimate:
    """What the twin states."""
    thing = bundle.objects[bundle.task.object]
    return DynamicsEstimate(
        task=bundle.task.name,
        embodiment=embodiment(bundle.robot),
        objects={
            bundle.task.object: ObjectDynamics(
                mass_kg=_kept(1.0, 1.0), friction=_kept(thing.friction, thing.friction_sigma)
            )
        },
        joints={},
        latency_s=_kept(bundle.latency_s, 0.0),
        periods={"free": 0, "carried": 0, "pushed": 0},
        runs=len(episodes),
        residual=0.0,
    )


def _kept(value: float, sigma: float) -> Estimate:
    return Estimate(value=value, sigma=sigma, prior=value, prior_sigma=sigma, why="nothing was simulated")

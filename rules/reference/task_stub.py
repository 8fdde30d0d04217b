"""reference.task without a simulator: the twin, labelled as reference world."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.scenes.world import World
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.rule import Backend, Context, Options

if TYPE_CHECKING:
    from .task import TaskOptions

BACKEND = Backend(summary="no simulation: the twin takes the place of the reference world", profiles=("stub",))


def build(ctx: Context, bundle: TaskBundle, world: World, common: TaskOptions, options: Options) -> TaskBundle:
    """Return the twin's model and objects unchanged."""
    still = {"mass_scale": (1.0, 1.0), "friction_sigma": 0.0, "scale_sigma": None}
    objects = {name: thing.model_copy(update=still) for name, thing in bundle.objects.items()}
    return bundle.model_copy(update={"objects": objects, "kind": "reference", "latency_s": common.latency_s})


def portraits(ctx: Context, bundle: TaskBundle, options: Options) -> list[tuple[str, np.ndarray]]:
    """No pictures."""
    return []

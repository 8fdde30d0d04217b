"""simulate.perturbed without a simulator: the twin, labelled as perturbed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.rule import Backend, Context, Options

if TYPE_CHECKING:
    from .perturbed import PerturbedOptions

BACKEND = Backend(summary="no simulation: nothing is disturbed", profiles=("stub",))


def build(
    ctx: Context, bundle: TaskBundle, common: PerturbedOptions, options: Options
) -> tuple[TaskBundle, dict[str, tuple[float, float, float]]]:
    """Return the twin's model and objects unchanged."""
    still = {"mass_scale": (1.0, 1.0), "friction_sigma": 0.0, "scale_sigma": None}
    objects = {name: thing.model_copy(update=still) for name, thing in bundle.objects.items()}
    changed = bundle.model_copy(update={"objects": objects, "kind": "perturbed", "latency_s": common.latency_s})
    return changed, dict.fromkeys(bundle.objects, (1.0, 1.0, 1.0))


def portraits(ctx: Context, bundle: TaskBundle, options: Options) -> list[tuple[str, np.ndarray]]:
    """No pictures."""
    return []

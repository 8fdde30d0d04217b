"""simulate.identified without a simulator: the model does not change."""

from __future__ import annotations

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.tasks.dynamics import DynamicsEstimate
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.rule import Backend, Context, Options

BACKEND = Backend(summary="the model does not change", profiles=("stub",))


def model(ctx: Context, bundle: TaskBundle, dynamics: DynamicsEstimate, options: Options) -> Folder:
    """The model of the task."""
    return bundle.model

"""simulate.task without a simulator: the files of scene and robot together."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.primitives import base as primitives

if TYPE_CHECKING:
    from .task import TaskOptions

BACKEND = Backend(summary="no simulation: scene and robot side by side", profiles=("stub",))


def fitted(
    ctx: Context, joints: Mapping[str, list[str]], common: TaskOptions, own: primitives.Options, options: Options
) -> tuple[TaskOptions, primitives.Options]:
    """Return the options adapted to the output of upstream stubs: the first object, and its joints.

    Args:
        ctx: The rule's context.
        joints: Body -> its joints.
        common: The rule's options.
        own: The options of the primitive.
        options: The backend's.
    """
    name = common.object if common.object in joints else next(iter(joints), common.object)
    return common.model_copy(update={"object": name}), own.fitted(joints.get(name, []))


def compose(ctx: Context, scene: Folder, robot: RobotModel, world_from_base: np.ndarray, options: Options) -> Folder:
    """Return all files of both."""
    return Folder(files={**scene.files, **robot.model.files})


def portraits(ctx: Context, bundle: TaskBundle, options: Options) -> list[tuple[str, np.ndarray]]:
    """No pictures."""
    return []

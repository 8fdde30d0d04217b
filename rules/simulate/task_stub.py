"""simulate.task without a simulator: the files of scene and robot together."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.robot import RobotModel
from dextera_build.artifacts.task import TaskBundle
from dextera_build.rule import Backend

if TYPE_CHECKING:
    from .task import TaskOptions

BACKEND = Backend(summary="no simulation: scene and robot side by side", profiles=("stub",))


def fitted(options: TaskOptions, joints: Mapping[str, list[str]]) -> TaskOptions:
    """Return the options, with the first object if upstream stubs did not find the requested one.

    Args:
        options: The recipe's options.
        joints: Body -> its joints.
    """
    if options.object in joints or not joints:
        return options
    name = next(iter(joints))
    if options.primitive == "articulate" and not joints[name]:
        return options.model_copy(update={"object": name, "primitive": "lift", "joints_deg": {}})
    return options.model_copy(update={"object": name, "joints_deg": dict.fromkeys(joints[name], 0.0)})


def compose(scene: Folder, robot: RobotModel, world_from_base: np.ndarray) -> Folder:
    """Return all files of both."""
    return Folder(files={**scene.files, **robot.model.files})


def portraits(bundle: TaskBundle) -> list[tuple[str, np.ndarray]]:
    """No pictures."""
    return []

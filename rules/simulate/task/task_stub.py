"""simulate.task without a simulator: the files of scene and robot together."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.robot import RobotModel
from dextera_build.artifacts.task import TaskBundle
from dextera_build.rule import Backend, Context, Options

if TYPE_CHECKING:
    from .task import TaskOptions

BACKEND = Backend(summary="no simulation: scene and robot side by side", profiles=("stub",))


def fitted(ctx: Context, joints: Mapping[str, list[str]], common: TaskOptions, options: Options) -> TaskOptions:
    """Return the options adapted to the output of upstream stubs: the first object, or one without the named joints.

    Args:
        ctx: The rule's context.
        joints: Body -> its joints.
        common: The rule's options.
        options: The backend's.
    """
    if common.into is not None:  # stubs find no containers
        common = common.model_copy(update={"into": None, "by_m": (0.1, 0.0, 0.0)})
    asked = set(common.joints_deg or {})
    if not joints or (common.object in joints and asked <= set(joints[common.object])):
        return common
    name = common.object if common.object in joints else next(iter(joints))
    if common.primitive == "articulate" and not joints[name]:
        plain = {"object": name, "primitive": "lift", "joints_deg": None, "tolerance_deg": None}
        return common.model_copy(update=plain)
    if common.primitive != "articulate":
        return common.model_copy(update={"object": name})
    return common.model_copy(update={"object": name, "joints_deg": dict.fromkeys(joints[name], 0.0)})


def compose(ctx: Context, scene: Folder, robot: RobotModel, world_from_base: np.ndarray, options: Options) -> Folder:
    """Return all files of both."""
    return Folder(files={**scene.files, **robot.model.files})


def portraits(ctx: Context, bundle: TaskBundle, options: Options) -> list[tuple[str, np.ndarray]]:
    """No pictures."""
    return []

"""simulate.mesh_robot without meshes: the unchanged robot."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.rule import Backend, Context, Options

if TYPE_CHECKING:
    from .mesh_robot import MeshRobotOptions

BACKEND = Backend(summary="no meshes: the robot unchanged", profiles=("stub",))


def dress(ctx: Context, like: RobotModel, own: Path, common: MeshRobotOptions, options: Options) -> Folder:
    """The files of `like`."""
    return like.model


def portrait(ctx: Context, robot: RobotModel, options: Options) -> np.ndarray | None:
    """No picture."""
    return None

"""Twins of assets on the plain table of `factories`."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.objects.object import Asset
from dextera_build.artifacts.scenes.scene import Background
from dextera_build.artifacts.scenes.scene_description import SceneDescription
from dextera_build.sim.model import mjcf
from dextera_build.sim.model.description import describe, parted
from tests import factories


def described(
    assets: Mapping[str, Asset],
    room: Background | None = None,
    lens: Camera | None = None,
    eye: np.ndarray | None = None,
) -> SceneDescription:
    """The assets, by label, without overlaps, in the room and seen from `eye`, T_world_camera (4, 4)."""
    room = room or factories.background()
    eye = factories.support().camera_pose.matrix if eye is None else eye
    return describe(parted(assets, room), room, lens or factories.camera(), eye)


def scene(assets: Mapping[str, Asset], room: Background | None = None, lens: Camera | None = None) -> Folder:
    """MJCF of `described`."""
    return mjcf.write(described(assets, room, lens))

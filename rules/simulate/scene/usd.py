"""simulate.usd: the twin as USD, for simulators and viewers."""

from __future__ import annotations

from typing import Any, Protocol

from pydantic import NonNegativeFloat

from dextera_build.artifacts.base import Collection, Folder
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.objects.object import Asset, Support
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.scenes.scene import Background, Scene
from dextera_build.artifacts.scenes.scene_description import Attachment, SceneDescription
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import listing
from dextera_build.rule import Context, Options, rule
from dextera_build.sim.model import description
from dextera_build.sim.usd import packing

from .amounts import amount
from .metric import metric

ROBOT = "robot/"
"""Prefix of the robot's names, as in a task."""


class UsdOptions(Options):
    """Options of simulate.usd."""

    form: packing.Form = "usda"
    """Text (`usda`), the binary form (`usdc`), or one file with the textures in it (`usdz`)."""
    white_nits: NonNegativeFloat = 1500.0
    """Luminance of a white level surface in the twin's lights [cd/m^2]: 1500 for the exposure of Isaac Sim, 1 for
    programs that show a radiance of 1 as white, as usdview does; 0 leaves the lights out."""


class UsdBackend(Protocol):
    """Interface of a backend of simulate.usd."""

    def write(
        self, ctx: Context, described: SceneDescription, held: tuple[str, ...], common: UsdOptions, options: Any
    ) -> Folder:
        """The stage and its textures; the objects in `held` do not move."""
        ...

    def problems(
        self, ctx: Context, folder: Folder, described: SceneDescription, held: tuple[str, ...], options: Any
    ) -> list[str]:
        """Errors and warnings of the validators, and differences from the MJCF of the scene, one line each."""
        ...


@rule(version=5, packages=("scipy",))
def usd(
    ctx: Context[UsdBackend],
    assets: Collection[Asset],
    background: Background,
    support: Support,
    camera: Camera,
    scene: Scene | None = None,
    robot: RobotModel | None = None,
    base: Pose | None = None,
    *,
    options: UsdOptions,
) -> Folder:
    """Return `scene.usda` and its textures [m, kg, degrees], z up, in the world frame, all paths relative.

    Rigid bodies with explicit mass properties, convex hulls as colliders, joints between sibling links. Objects that
    are fixed in `scene` are fixed here, too. A `robot` is placed at `base`, T_world_base, as an articulation with
    drives. The lights are those of the MJCF. The stage is read back and compared with MuJoCo's model of the same scene.
    """
    held = () if scene is None else tuple(scene.held)
    room = metric(background, support.factor)
    found = description.parted(assets.items, room)
    described = description.describe(found, room, camera, support.camera_pose.matrix)
    if robot is not None:
        if base is None or (base.parent, base.child) != ("world", "base"):
            given = "nothing" if base is None else f"T_{base.parent}_{base.child}"
            ctx.fail("the robot has no place in the scene", base=given, hint="`base: $node` that returns T_world_base")
        here = Attachment(prefix=ROBOT, robot=robot, pose=base)
        described = described.model_copy(update={"attachments": (here,)})
    result: Folder = ctx.backend.write(ctx, described, held, options, ctx.backend_options)
    ctx.check(bool(packing.main(result)), "the folder holds no stage `scene`", files=listing(result.files))
    problems = ctx.backend.problems(ctx, result, described, held, ctx.backend_options)
    ctx.check(not problems, f"the USD is not valid: {problems[0] if problems else ''}", problems=len(problems))
    size = sum(len(data) for data in result.files.values()) / 1e6
    joints = sum(len(asset.body.joints) for asset in assets.items.values())
    ctx.metric("size", size, "MB")
    fixed = f", {len(held)} held" if held else ""
    with_robot = "" if robot is None else f", a robot of {len(robot.joints)} joints"
    counts = f"{amount(len(assets.items), 'object')}, {amount(joints, 'joint')}"
    ctx.say(f"{counts}{fixed}{with_robot}, valid, {size:.1f} MB")
    return result

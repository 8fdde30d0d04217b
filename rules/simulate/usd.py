"""simulate.usd: the twin as USD, for simulators and viewers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

from dextera_build.artifacts.base import Collection, Folder
from dextera_build.artifacts.camera import Camera
from dextera_build.artifacts.object import Asset, Support
from dextera_build.artifacts.scene import Background, Scene
from dextera_build.errors import listing
from dextera_build.rule import Context, rule

from .metric import metric


class UsdBackend(Protocol):
    """What a backend of simulate.usd defines."""

    def write(
        self,
        ctx: Context,
        assets: Mapping[str, Asset],
        background: Background,
        camera: Camera,
        world_from_camera: np.ndarray,
        held: tuple[str, ...],
        options: Any,
    ) -> Folder:
        """The stage and its textures; the objects in `held` do not move."""
        ...

    def problems(self, ctx: Context, folder: Folder, options: Any) -> list[str]:
        """Errors and warnings of the validators, one line each."""
        ...


@rule(version=3)
def usd(
    ctx: Context[UsdBackend],
    assets: Collection[Asset],
    background: Background,
    support: Support,
    camera: Camera,
    scene: Scene | None = None,
) -> Folder:
    """Return `scene.usda` and its textures [m, kg, degrees], z up, in the world frame, all paths relative.

    Rigid bodies with explicit mass properties, convex hulls as colliders, joints between sibling links. The objects
    that `scene` holds cannot move here either.
    """
    held = () if scene is None else scene.held
    room = metric(background, support.factor)
    pose = support.camera_pose.matrix
    result: Folder = ctx.backend.write(ctx, assets.items, room, camera, pose, held, ctx.backend_options)
    ctx.check("scene.usda" in result.files, "the folder holds no `scene.usda`", files=listing(result.files))
    problems = ctx.backend.problems(ctx, result, ctx.backend_options)
    ctx.check(not problems, f"the USD is not valid: {problems[0] if problems else ''}", problems=len(problems))
    size = sum(len(data) for data in result.files.values()) / 1e6
    joints = sum(len(asset.body.joints) for asset in assets.items.values())
    ctx.metric("size", size, "MB")
    fixed = f", {len(held)} held" if held else ""
    ctx.say(f"{len(assets.items)} objects, {joints} joints{fixed}, valid, {size:.1f} MB")
    return result

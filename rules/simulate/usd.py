"""simulate.usd: the twin as USD, for simulators and viewers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

from dextera_build.artifacts.base import Collection, Folder
from dextera_build.artifacts.camera import Camera
from dextera_build.artifacts.object import Asset, Support
from dextera_build.artifacts.scene import Background
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
        options: Any,
    ) -> Folder:
        """The stage and its textures."""
        ...

    def problems(self, ctx: Context, folder: Folder, options: Any) -> list[str]:
        """Errors and warnings of the validators, one line each."""
        ...


@rule(version=1)
def usd(
    ctx: Context[UsdBackend], assets: Collection[Asset], background: Background, support: Support, camera: Camera
) -> Folder:
    """Return `scene.usda` and its textures [m, kg, degrees], z up, in the world frame, all paths relative.

    Rigid bodies with explicit mass properties, convex hulls as colliders, joints between sibling links.
    """
    result: Folder = ctx.backend.write(
        ctx, assets.items, metric(background, support.factor), camera, support.camera_pose.matrix, ctx.backend_options
    )
    ctx.check("scene.usda" in result.files, "the folder holds no `scene.usda`", files=listing(result.files))
    problems = ctx.backend.problems(ctx, result, ctx.backend_options)
    ctx.check(not problems, f"the USD is not valid: {problems[0] if problems else ''}", problems=len(problems))
    size = sum(len(data) for data in result.files.values()) / 1e6
    joints = sum(len(asset.body.joints) for asset in assets.items.values())
    ctx.metric("size", size, "MB")
    ctx.say(f"{len(assets.items)} objects, {joints} joints, valid, {size:.1f} MB")
    return result

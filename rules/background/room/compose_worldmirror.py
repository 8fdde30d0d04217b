"""background.compose by WorldMirror 2.0 (HY-World 2.0, Tencent 2026) in its own environment."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from pydantic import Field

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.image import DepthImage, Image
from dextera_build.artifacts.cameras.views import Views
from dextera_build.artifacts.scenes.room import Room
from dextera_build.artifacts.scenes.scene import Background
from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.artifacts.spatial.pose import Similarity
from dextera_build.errors import ArtifactError
from dextera_build.formats import point_cloud, splats_ply
from dextera_build.rule import Backend, Context, Fraction, Options

from .alignment import between

BACKEND = Backend(
    summary="WorldMirror 2.0 predicts Gaussians, points and depth from the views and their cameras",
    packages=("numpy", "pillow"),
    command=("{python}", "worldmirror_program.py"),
    environment="venv:.envs/worldmirror",
    lock="envs/worldmirror.lock",
    server=True,
    gpu_gb=24.0,
    timeout_s=1800.0,
    weights=("worldmirror_2",),
    licence="Tencent HY-World 2.0 Community License",
)

OWN = "worldmirror"
"""Frame of the result: that of its first camera, in an unknown unit."""


class WorldMirrorOptions(Options):
    """Options of backend `worldmirror` of background.compose."""

    longest_px: int = Field(952, ge=56, le=952)
    """Longest side of the network's input, rounded down to a multiple of 14 [px]."""
    bf16: bool = True
    """Use half precision, as its authors propose for smaller GPUs."""
    most_misfit: Fraction = 0.1
    """Maximum distance of a returned camera from the given one, relative to the extent of the cameras."""


def compose(ctx: Context, views: Views, background: Background | None, options: WorldMirrorOptions) -> Room:
    """The network's prediction, transformed to the frame of the views by the cameras that it returns.

    The background is not used. Opacities in its file are values, not logits.
    """
    lenses = [views.lens(name) for name in views.names]
    if not all(isinstance(lens, Camera) for lens in lenses):
        ctx.fail("worldmirror takes pictures of pinhole cameras", hint="undistort them, or use backend `points`")
    if len({(lens.width, lens.height) for lens in lenses}) > 1:
        ctx.fail("worldmirror takes pictures of one size", hint="use backend `points`")
    matrices = np.array([lens.matrix() for lens in lenses if isinstance(lens, Camera)])
    pictures = [Image(pixels=views.pixels(name)) for name in views.names]
    made = ctx.outside("compose", Folder, pictures=pictures, poses=views.poses, intrinsics=matrices)
    folder = Path(ctx.scratch, "worldmirror")
    made.export(folder, "")
    try:
        motion = _motion(ctx, folder, views, options)
        splats = _with_plain_opacities(splats_ply.load(folder / "gaussians.ply", frame=OWN)).moved(motion)
        points = point_cloud.load(folder / "points.ply", frame=OWN).moved(motion)
        depth = {
            name: _depth(folder / "depth" / f"depth_{number:04d}.npy", motion.scale, lens.height, lens.width)
            for number, (name, lens) in enumerate(zip(views.names, lenses, strict=True))
        }
    except (OSError, ValueError, KeyError, TypeError, ArtifactError) as error:
        ctx.fail(f"the answer of worldmirror cannot be read: {error}", hint="use backend `points`")
    return Room(splats=splats, points=points, depth=depth)


def _motion(ctx: Context, folder: Path, views: Views, options: WorldMirrorOptions) -> Similarity:
    """S_frame_worldmirror from the cameras of the result, `camera_params.json`, to those of the views."""
    answer = json.loads((folder / "camera_params.json").read_text())
    poses = np.array([camera["matrix"] for camera in answer["extrinsics"]], np.float64)
    if poses.shape != views.poses.shape or not np.isfinite(poses).all():
        raise ValueError(f"it holds poses of shape {poses.shape} for {len(views.names)} views")
    scale, motion, misfit = between(poses, views.poses)
    extent = float(np.linalg.norm(np.ptp(views.poses[:, :3, 3], axis=0)))
    ctx.metric("misfit of the cameras", 1000.0 * misfit, "mm")
    ctx.check(
        misfit <= options.most_misfit * extent,
        "worldmirror did not keep to the given cameras",
        misfit=f"{1000 * misfit:.1f} mm",
        extent=f"{1000 * extent:.1f} mm",
        hint="views from places farther apart; or raise `most_misfit`; or use backend `points`",
    )
    return Similarity(parent=views.frame, child=OWN, matrix=motion, scale=scale)


def _with_plain_opacities(splats: Splats) -> Splats:
    """The Gaussians of a file whose column `opacity` holds 0..1, with the sigmoid of reading undone.

    A file with a value outside 0..1 contains logits and is unchanged.
    """
    read = splats.opacities.astype(np.float64).clip(1e-12, 1 - 1e-12)
    column = np.log(read) - np.log1p(-read)
    if column.min(initial=0.0) < -1e-3 or column.max(initial=0.0) > 1 + 1e-3:
        return splats
    return splats.model_copy(update={"opacities": column.clip(0.0, 1.0).astype(np.float32)})


def _depth(path: Path, scale: float, height: int, width: int) -> DepthImage:
    """The depth of a view [m], of the size of its picture; the network sees the whole picture, smaller."""
    found = np.load(path, allow_pickle=False)
    found = found.reshape(found.shape[:2])
    rows = ((np.arange(height) + 0.5) * found.shape[0] / height).astype(int)
    columns = ((np.arange(width) + 0.5) * found.shape[1] / width).astype(int)
    metric = scale * found[np.ix_(rows, columns)]
    return DepthImage(depth=np.where(np.isfinite(metric) & (metric > 0), metric, 0.0).astype(np.float32))

"""reference.background_views: posed RGB-D views of a world without its objects; accepted only by rules that judge."""

from __future__ import annotations

import io
import json
from typing import Any, Protocol

import numpy as np
from PIL import Image as Pillow
from pydantic import NonNegativeFloat, NonNegativeInt, PositiveInt

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.scenes.world import World
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import cameras
from dextera_build.rule import Context, Options, rule
from dextera_build.sim.render.shot import Shot

COUNT_M = 0.0001
"""Depth of one count of the pictures [m]."""
LOW_RAD, HIGH_RAD = 0.25, 1.25
"""Range of pitches of the lines of sight below the horizon [rad]."""


class BackgroundViewsOptions(Options):
    """Options of reference.background_views. Differences from the capture are uniform within plus or minus a limit."""

    views: PositiveInt = 5
    """Number of views in addition to the capture's own."""
    heading_deg: NonNegativeFloat = 30.0
    """Largest difference of the heading [deg]."""
    pitch_deg: NonNegativeFloat = 10.0
    """Largest difference of the angle below the horizon [deg]."""
    distance: NonNegativeFloat = 0.2
    """Largest relative difference of the distance."""
    supersample: PositiveInt = 2
    """Samples per pixel edge of the colour render."""
    seed: NonNegativeInt = 0
    """Seed of the differences."""


class CameraBackend(Protocol):
    """Interface of a backend of reference.background_views."""

    def photograph(self, ctx: Context, world: World, supersample: int, soft: bool, options: Any) -> Shot:
        """Colours, depth [m] and object labels of the world's camera, without noise; `soft` adds soft shadows."""
        ...


@rule(version=1, packages=("numpy", "pillow"), cpus=2, memory_gb=2.0)
def background_views(
    ctx: Context[CameraBackend], world: World, *, options: BackgroundViewsOptions | None = None
) -> Folder:
    """Return `views.json` with noise-free pictures and depth of table, room and furniture; the first is the capture's.

    The other cameras look at the same point of the table from other poses T_reference_camera [m]. `capture.json` names
    a mask of the pixels that show objects in the capture.
    """
    options = options or BackgroundViewsOptions()
    facts = {name: getattr(world.camera, name) for name in ("width", "height", "fx", "fy", "cx", "cy")}
    poses = [world.camera_pose.matrix, *_elsewhere(world.camera_pose.matrix, options)]
    things = ctx.backend.photograph(ctx, world, 1, False, ctx.backend_options).labels > 0
    files: dict[str, bytes] = {
        "capture.json": json.dumps({"frame": 0, "objects": "objects.png"}).encode(),
        "objects.png": _png(255 * things.astype(np.uint8)),
    }
    views, shown = [], []
    for number, pose in enumerate(poses):
        seen = world.model_copy(
            update={"objects": {}, "camera_pose": Pose(parent="reference", child="camera", matrix=pose)}
        )
        shot = ctx.backend.photograph(ctx, seen, options.supersample, True, ctx.backend_options)
        pixels = np.asarray(np.round(np.clip(shot.rgb, 0, 1) * 255), np.uint8)
        names = {"rgb": f"views/{number:03d}.png", "depth": f"views/{number:03d}.depth.png"}
        counts = np.where(shot.depth < 65534 * COUNT_M, np.round(shot.depth / COUNT_M), 0)
        files[names["rgb"]], files[names["depth"]] = _png(pixels), _png(counts.astype(np.uint16))
        views.append({"frame": number, **names, "T_world_camera": pose.tolist()})
        shown.append(pixels[:: max(1, len(pixels) // 160), :: max(1, len(pixels) // 160)])
        ctx.progress(number + 1, len(poses), "views")
    files["views.json"] = json.dumps({**facts, "depth_scale_m": COUNT_M, "views": views}).encode()
    ctx.say(f"{options.views} views in addition to the capture's, {world.camera.width} x {world.camera.height} px")
    ctx.preview(np.hstack(shown), "the world without its things, the capture's view first")
    return Folder(files=files)


def _elsewhere(pose: np.ndarray, options: BackgroundViewsOptions) -> list[np.ndarray]:
    """Cameras around the point of the table that the camera with `pose` (4, 4) looks at."""
    ahead, place = pose[:3, 2], pose[:3, 3]
    distance = float(place[2] / -ahead[2]) if ahead[2] < -0.05 else 1.0
    target = place + distance * ahead
    heading, pitch = float(np.arctan2(ahead[0], ahead[1])), float(np.arcsin(-ahead[2]))
    rng = np.random.default_rng(options.seed)
    found = []
    for _ in range(options.views):
        turn, tilt, away = rng.uniform(-1, 1, 3)
        found.append(
            cameras.look_down(
                target,
                distance * (1 + away * options.distance),
                heading + np.radians(turn * options.heading_deg),
                float(np.clip(pitch + np.radians(tilt * options.pitch_deg), LOW_RAD, HIGH_RAD)),
                0.0,
            )
        )
    return found


def _png(pixels: np.ndarray) -> bytes:
    data = io.BytesIO()
    Pillow.fromarray(pixels).save(data, "PNG")
    return data.getvalue()

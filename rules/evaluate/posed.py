"""`views.json`: posed RGB-D views of one scene, parsed as untrusted data."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.errors import listing
from dextera_build.rule import Context

NAME = "views.json"
CAPTURE = "capture.json"
_LARGEST = 65535
"""Depth that many drivers write for missing returns [counts]."""


@dataclass(frozen=True)
class PosedView:
    """One picture with its depth and its camera's pose."""

    frame: int
    rgb: np.ndarray  # (H, W, 3) uint8 sRGB
    depth: np.ndarray  # (H, W) float64, image-plane z [m]; 0 if invalid
    pose: np.ndarray  # (4, 4) T_room_camera, OpenCV axes


class PosedViews:
    """The views of a folder, decoded one at a time.

    `views.json` holds width, height, fx, fy, cx, cy [px], `depth_scale_m` [m per count], and under `views` a list of
    `frame`, `rgb`, `depth` (paths in the folder) and `T_world_camera` (4 x 4, OpenCV axes). `capture.json` names the
    `frame` that the twin was made from, and may name under `objects` a mask of the objects in the capture (not 0).
    """

    def __init__(self, ctx: Context, folder: Folder) -> None:
        self._ctx, self._files = ctx, folder.files
        facts, capture = _object(ctx, folder, NAME), _object(ctx, folder, CAPTURE)
        try:
            self.camera = Camera(**{name: facts[name] for name in ("width", "height", "fx", "fy", "cx", "cy")})
            self._scale = float(facts["depth_scale_m"])
            self._views = {int(view["frame"]): view for view in facts["views"]}
            self.poses = {frame: _pose(view["T_world_camera"]) for frame, view in self._views.items()}
            self.own = int(capture["frame"])
            self._objects = str(capture.get("objects", ""))
        except (KeyError, TypeError, ValueError) as error:
            ctx.fail(f"`{NAME}` or `{CAPTURE}` is incomplete", reader=f"{type(error).__name__}: {error}")
        if self.own not in self.poses:
            ctx.fail(
                f"`{NAME}` lacks the frame of the capture",
                frame=self.own,
                frames=listing([str(frame) for frame in self.poses]),
            )
        if len(self.poses) < 2:
            ctx.fail(f"`{NAME}` holds no view other than the capture's", frames=len(self.poses))

    def others(self) -> Iterator[PosedView]:
        """All views but the capture's own, in the order of their frames."""
        yield from (self.view(frame) for frame in sorted(self._views) if frame != self.own)

    def objects(self) -> np.ndarray:
        """Pixels (H, W) bool of the capture that show objects, from its folder; none if it has no mask."""
        if not self._objects:
            return np.zeros((self.camera.height, self.camera.width), bool)
        return self._picture(self._objects, None) > 0

    def view(self, frame: int) -> PosedView:
        """The view of one frame."""
        facts = self._views[frame]
        rgb, counts = (self._picture(str(facts[key]), mode) for key, mode in (("rgb", "RGB"), ("depth", None)))
        return PosedView(frame, rgb, np.where(counts == _LARGEST, 0.0, counts * self._scale), self.poses[frame])

    def _picture(self, name: str, mode: str | None) -> np.ndarray:
        from PIL import Image

        if name not in self._files:
            self._ctx.fail(f"`{name}` is missing", named_by=NAME, here=listing(self._files))
        try:
            with Image.open(io.BytesIO(self._files[name]), formats=("PNG", "JPEG")) as opened:
                pixels = np.array(opened.convert(mode) if mode else opened)
        except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
            self._ctx.fail(f"`{name}` is no readable picture", decoder=str(error))
        if pixels.shape[:2] != (self.camera.height, self.camera.width) or pixels.ndim != (3 if mode else 2):
            self._ctx.fail(
                f"`{name}` does not have the size in `{NAME}`",
                picture=" x ".join(str(n) for n in pixels.shape),
                camera=f"{self.camera.width} x {self.camera.height} px",
            )
        return pixels


def _object(ctx: Context, folder: Folder, name: str) -> dict[str, Any]:
    if name not in folder.files:
        ctx.fail(f"`{name}` is missing", here=listing(folder.files))
    try:
        facts = json.loads(folder.files[name])
    except (ValueError, RecursionError) as error:
        ctx.fail(f"`{name}` is not valid JSON", parser=str(error))
    if not isinstance(facts, dict):
        ctx.fail(f"`{name}` must hold an object", found=type(facts).__name__)
    return facts


def _pose(rows: object) -> np.ndarray:
    pose = np.asarray(rows, np.float64)
    if pose.shape != (4, 4) or not np.isfinite(pose).all() or abs(np.linalg.det(pose[:3, :3]) - 1.0) > 1e-3:
        raise ValueError("T_world_camera is no rigid motion")
    return pose

"""capture.folder: read an RGB-D photograph from a folder of files."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.camera import Camera, Capture
from dextera_build.artifacts.image import DepthImage, Image
from dextera_build.errors import listing
from dextera_build.rule import Context, Options, rule

from .pictures import counts, pixels

RGB = ("rgb.png", "rgb.jpg", "rgb.jpeg")
DEPTH = ("depth.png", "depth.npy")
INTRINSICS = ("width", "height", "fx", "fy", "cx", "cy")
SATURATED = 65535  # many drivers write it where nothing came back


class FolderOptions(Options):
    """Options of capture.folder."""

    nearest_m: float = 0.1
    """Smallest median depth that is believed [m]."""
    farthest_m: float = 20.0
    """Largest median depth that is believed [m]."""


@rule(version=1, packages=("pillow",))
def folder(ctx: Context, folder: Folder, *, options: FolderOptions) -> Capture:
    """Return the capture in `capture.json`, `rgb.png` or `rgb.jpg`, and `depth.png` or `depth.npy`.

    `capture.json` holds width, height, fx, fy, cx, cy [px] (OpenCV convention, integer pixel centres) and, for a
    `depth.png` of 16 bit counts, `depth_scale_m` [m per count]. Depth is image-plane z; 0 and 65535 counts are invalid.
    A `depth.npy` holds metres.
    """
    facts = _facts(ctx, folder)
    camera = _camera(ctx, facts)
    name = _one_of(ctx, folder, RGB)
    rgb = pixels(ctx, folder.files[name], name, "RGB")
    _check_size(ctx, name, rgb.shape[:2], camera)
    name = _one_of(ctx, folder, DEPTH)
    depth = _depth(ctx, folder.files[name], name, facts)
    if depth.shape != rgb.shape[:2]:
        ctx.fail(
            "the depth image and the photograph differ in size",
            depth=f"{depth.shape[1]} x {depth.shape[0]} px",
            photograph=f"{rgb.shape[1]} x {rgb.shape[0]} px",
            hint="register the depth to the colour camera before writing the capture",
        )
    _check_depth(ctx, depth, name, options)
    valid = depth > 0
    share, middle = valid.mean(), np.median(depth[valid])
    ctx.say(f"{camera.width} x {camera.height} px, depth on {share:.0%} of them, median {middle:.2f} m")
    ctx.preview(rgb, "photograph")
    return Capture(rgb=Image(pixels=rgb), depth=DepthImage(depth=depth), camera=camera)


def _one_of(ctx: Context, folder: Folder, names: tuple[str, ...]) -> str:
    present = [name for name in names if name in folder.files]
    if not present:
        ctx.fail(
            f"`{names[0]}` is missing in the capture",
            wanted=" or ".join(f"`{name}`" for name in names),
            here=listing(folder.files),
            hint=f"put `{names[0]}` into the capture's folder",
        )
    return present[0]


def _facts(ctx: Context, folder: Folder) -> Mapping[str, Any]:
    name = _one_of(ctx, folder, ("capture.json",))
    try:
        facts = json.loads(folder.files[name])
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        ctx.fail(f"`{name}` is not valid JSON", parser=str(error), hint=f"`python -m json.tool {name}` shows the place")
    if not isinstance(facts, dict):
        ctx.fail(f"`{name}` must hold an object", found=type(facts).__name__, hint='begin it with `{"width": 640, ...`')
    return facts


def _camera(ctx: Context, facts: Mapping[str, Any]) -> Camera:
    missing = [key for key in INTRINSICS if key not in facts]
    if missing:
        ctx.fail(
            "`capture.json` lacks intrinsics",
            missing=listing(missing),
            here=listing(facts),
            hint="write width, height, fx, fy, cx and cy in pixels",
        )
    wrong = [key for key in INTRINSICS if isinstance(facts[key], bool) or not isinstance(facts[key], int | float)]
    if wrong or facts["fx"] <= 0 or facts["fy"] <= 0:
        key = wrong[0] if wrong else "fx" if facts["fx"] <= 0 else "fy"
        ctx.fail(f"`capture.json`: `{key}` must be a positive number of pixels", found=repr(facts[key]))
    camera = Camera(
        width=int(facts["width"]),
        height=int(facts["height"]),
        **{key: float(facts[key]) for key in ("fx", "fy", "cx", "cy")},
    )
    if not (0 <= camera.cx <= camera.width and 0 <= camera.cy <= camera.height):
        ctx.fail(
            "the intrinsics do not match the image size: the principal point lies outside the image",
            principal_point=f"{camera.cx:g}, {camera.cy:g} px",
            image=f"{camera.width} x {camera.height} px",
            hint="scale fx, fy, cx and cy by the factor that the image was resized by",
        )
    return camera


def _check_size(ctx: Context, name: str, shape: tuple[int, ...], camera: Camera) -> None:
    if shape != (camera.height, camera.width):
        ctx.fail(
            "the intrinsics do not match the image size",
            capture_json=f"{camera.width} x {camera.height} px",
            **{name: f"{shape[1]} x {shape[0]} px"},
            hint="write the intrinsics of this resolution; fx, fy, cx and cy scale with the image",
        )


def _depth(ctx: Context, data: bytes, name: str, facts: Mapping[str, Any]) -> np.ndarray:
    if name.endswith(".npy"):
        return _metres(ctx, data, name)
    scale = facts.get("depth_scale_m")
    if isinstance(scale, bool) or not isinstance(scale, int | float) or not scale > 0:
        ctx.fail(
            "the depth has no scale",
            depth_scale_m="missing in `capture.json`" if scale is None else repr(scale),
            hint='add `"depth_scale_m": 0.001` to `capture.json` where one count is a millimetre',
        )
    values = counts(ctx, data, name)
    return np.where(values == SATURATED, 0.0, values * float(scale)).astype(np.float32)


def _metres(ctx: Context, data: bytes, name: str) -> np.ndarray:
    try:
        depth = np.load(io.BytesIO(data), allow_pickle=False)
    except (ValueError, OSError, EOFError) as error:
        ctx.fail(f"`{name}` is truncated or damaged", size=f"{len(data):,} bytes", reader=str(error))
    if depth.ndim != 2 or depth.dtype.kind != "f":
        ctx.fail(
            f"`{name}` must hold one number of metres per pixel",
            shape=" x ".join(str(n) for n in depth.shape),
            dtype=str(depth.dtype),
            hint=f"write `{name}` as (height, width) float32",
        )
    bad = int((~np.isfinite(depth)).sum())
    if bad:
        ctx.fail(
            f"`{name}` holds NaN or infinite depth",
            pixels=f"{bad:,} of {depth.size:,}",
            hint="write 0 where nothing was measured: `np.nan_to_num(depth, nan=0, posinf=0, neginf=0)`",
        )
    return np.asarray(depth, dtype=np.float32)


def _check_depth(ctx: Context, depth: np.ndarray, name: str, options: FolderOptions) -> None:
    if (depth < 0).any():
        ctx.fail(
            f"`{name}` holds negative depth", smallest=f"{depth.min():g} m", hint="write 0 where nothing was measured"
        )
    valid = depth[depth > 0]
    if not len(valid):
        ctx.fail(
            f"`{name}` holds no valid depth",
            pixels=f"0 of {depth.size:,}",
            hint="check that the depth stream was running",
        )
    middle = float(np.median(valid))
    if not options.nearest_m <= middle <= options.farthest_m:
        ctx.fail(
            "the depth's unit is not plausible",
            median=f"{middle:.4g} m",
            believed=f"{options.nearest_m:g} to {options.farthest_m:g} m",
            hint="check `depth_scale_m` in `capture.json`: metres per count, 0.001 for millimetres",
        )

"""capture.folder: read a photograph, and its depth if there is some, from a folder of files."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from pydantic import PositiveFloat

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.camera import Capture, Measured, Photograph
from dextera_build.artifacts.image import DepthImage, Image
from dextera_build.errors import listing
from dextera_build.rule import Context, Options, rule

from .facts import camera_of, depth_scale, read
from .pictures import counts, metres, pixels, size

RGB = ("rgb.png", "rgb.jpg", "rgb.jpeg")
DEPTH = ("depth.png", "depth.npy")
SATURATED = 65535  # written by many drivers for missing returns


class FolderOptions(Options):
    """Options of capture.folder."""

    nearest_m: PositiveFloat = 0.1
    """Minimum accepted median depth [m]."""
    farthest_m: PositiveFloat = 20.0
    """Maximum accepted median depth [m]."""


@rule(version=2, packages=("pillow",))
def folder(ctx: Context, folder: Folder, *, options: FolderOptions) -> Capture:
    """Return the capture in `capture.json`, `rgb.png` or `rgb.jpg`, and, if there is depth, `depth.png` or `depth.npy`.

    `capture.json` contains width, height, fx, fy, cx, cy [px] (OpenCV convention, integer pixel centres) and, for a
    `depth.png` of 16 bit counts, `depth_scale_m` [m per count]. Depth is image-plane z; 0 and 65535 counts are invalid.
    A `depth.npy` contains metres.
    """
    facts = read(ctx, folder.files[_one_of(ctx, folder, ("capture.json",))])
    camera = camera_of(ctx, facts)
    picture = _one_of(ctx, folder, RGB)
    seen = size(ctx, folder.files[picture], picture)
    if seen != (camera.width, camera.height):
        ctx.fail(
            "the intrinsics do not match the image size",
            capture_json=_spelled((camera.width, camera.height)),
            **{picture: _spelled(seen)},
            hint="write the intrinsics of this resolution; fx, fy, cx and cy scale with the image",
        )
    # Everything about the depth is checked before the photograph is decoded.
    name = next((name for name in DEPTH if name in folder.files), None)
    if name is None and "depth_scale_m" in facts:
        _one_of(ctx, folder, DEPTH)
    if name is not None:
        _check_same_size(ctx, size(ctx, folder.files[name], name), seen)
    rgb = pixels(ctx, folder.files[picture], picture, "RGB")
    ctx.preview(rgb, "photograph")
    photograph = Photograph(rgb=Image(pixels=rgb), camera=camera)
    if name is None:
        ctx.say(f"{camera.width} x {camera.height} px, no depth")
        return Capture(photograph=photograph)
    depth = _depth(ctx, folder.files[name], name, facts)
    _check_depth(ctx, depth, name, options)
    valid = depth > 0
    share, middle = valid.mean(), np.median(depth[valid])
    ctx.say(f"{camera.width} x {camera.height} px, depth on {share:.0%} of them, median {middle:.2f} m")
    return Capture(photograph=photograph, measured=Measured(depth=DepthImage(depth=depth)))


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


def _check_same_size(ctx: Context, depth: tuple[int, int], rgb: tuple[int, int]) -> None:
    if depth != rgb:
        ctx.fail(
            "the depth image and the photograph differ in size",
            depth=_spelled(depth),
            photograph=_spelled(rgb),
            hint="register the depth to the colour camera before writing the capture",
        )


def _spelled(size: tuple[int, int]) -> str:
    return f"{size[0]} x {size[1]} px"


def _depth(ctx: Context, data: bytes, name: str, facts: Mapping[str, object]) -> np.ndarray:
    if name.endswith(".npy"):
        return metres(ctx, data, name)
    scale = depth_scale(ctx, facts)
    values = counts(ctx, data, name)
    return np.where(values == SATURATED, 0.0, values * scale).astype(np.float32)


def _check_depth(ctx: Context, depth: np.ndarray, name: str, options: FolderOptions) -> None:
    bad = int((~np.isfinite(depth)).sum())
    if bad:
        ctx.fail(
            f"`{name}` holds NaN or infinite depth",
            pixels=f"{bad:,} of {depth.size:,}",
            hint="write 0 where nothing was measured: `np.nan_to_num(depth, nan=0, posinf=0, neginf=0)`",
        )
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
            hint=f"`{name}` holds metres: divide millimetres by 1000"
            if name.endswith(".npy")
            else "check `depth_scale_m` in `capture.json`: metres per count, 0.001 for 16 bit millimetres",
        )

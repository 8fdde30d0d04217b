"""capture.folder: read a photograph, and its depth if there is some, from a folder of files."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from pydantic import PositiveFloat

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.camera import Camera, Capture, Measured, Photograph
from dextera_build.artifacts.image import DepthImage, Image
from dextera_build.errors import listing
from dextera_build.rule import Context, Options, rule

from . import doubts, exif
from .facts import NAME, depth_scale, read
from .intrinsics import lens_of
from .pictures import bits_of, counts, metres, pixels, size
from .pinhole import Lens, nearest, pinhole, places, smooth

RGB = ("rgb.png", "rgb.jpg", "rgb.jpeg")
DEPTH = ("depth.png", "depth.npy")
SATURATED = 65535  # written by many drivers for missing returns


class FolderOptions(Options):
    """Options of capture.folder."""

    nearest_m: PositiveFloat = 0.1
    """Minimum accepted median depth [m]."""
    farthest_m: PositiveFloat = 20.0
    """Maximum accepted median depth [m]."""


@rule(version=3, packages=("pillow",))
def folder(ctx: Context, folder: Folder, *, options: FolderOptions) -> Capture:
    """Return the capture in `capture.json`, `rgb.png` or `rgb.jpg`, and, if there is depth, `depth.png` or `depth.npy`.

    `capture.json` contains width, height, fx, fy, cx, cy [px] (OpenCV convention, integer pixel centres) and, for a
    `depth.png` of 16 bit counts, `depth_scale_m` [m per count]. Depth is image-plane z; 0 and 65535 counts are invalid.
    A `depth.npy` contains metres.

    A photograph is turned as its EXIF orientation says, and `distortion` (OpenCV's k1 k2 p1 p2 k3 ...) is taken out.
    Without intrinsics they come from `camera_info.yaml` or `cameras.txt`, as for `capture.lens`, or from the focal
    length in the EXIF, with a warning.
    """
    picture = _one_of(ctx, folder, RGB)
    tags = exif.read(ctx, folder.files[picture], picture)
    facts = read(ctx, folder.files[NAME]) if NAME in folder.files else {}
    lens = lens_of(ctx, folder, facts, tags)
    orientation = _orientation(ctx, lens, tags, picture)
    seen = (lens.width, lens.height)
    # Everything about the depth is checked before the photograph is decoded.
    name = next((name for name in DEPTH if name in folder.files), None)
    if name is None and "depth_scale_m" in facts:
        _one_of(ctx, folder, DEPTH)
    if name is not None:
        _check_same_size(ctx, size(ctx, folder.files[name], name), seen)
    rgb = exif.upright(pixels(ctx, folder.files[picture], picture, "RGB"), orientation)
    depth = None if name is None else _depth(ctx, folder.files[name], name, facts, options)
    camera = lens if isinstance(lens, Camera) else pinhole(lens)
    if not isinstance(lens, Camera):
        where = places(lens)
        rgb, depth = smooth(rgb, where), None if depth is None else nearest(depth, where)
    doubts.of_camera(ctx, camera)
    ctx.preview(rgb, "photograph")
    how = f"{camera.width} x {camera.height} px" + (", turned as its EXIF says" if orientation > 1 else "")
    photograph = Photograph(rgb=Image(pixels=rgb), camera=camera)
    if depth is None:
        ctx.say(f"{how}, no depth")
        return Capture(photograph=photograph)
    doubts.of_registration(ctx, rgb, depth)
    valid = depth > 0
    share, middle = valid.mean(), np.median(depth[valid])
    ctx.say(f"{how}, depth on {share:.0%} of them, median {middle:.2f} m")
    return Capture(photograph=photograph, measured=Measured(depth=DepthImage(depth=depth)))


def _orientation(ctx: Context, lens: Camera | Lens, tags: exif.Exif, picture: str) -> int:
    """How the stored picture is turned so that it has the size of the intrinsics, 1 to 8."""
    wanted = (lens.width, lens.height)
    if tags.upright_size == wanted:
        return tags.orientation
    if tags.size != wanted:
        ctx.fail(
            "the intrinsics do not match the image size",
            capture_json=_spelled(wanted),
            **{picture: _spelled(tags.upright_size)},
            hint="write the intrinsics of this resolution; fx, fy, cx and cy scale with the image",
        )
    ctx.warn(
        f"`{picture}` has EXIF orientation {tags.orientation}, but the intrinsics are those of the picture as it is "
        "stored, so it was not turned"
    )
    return 1


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


def _depth(ctx: Context, data: bytes, name: str, facts: Mapping[str, object], options: FolderOptions) -> np.ndarray:
    """Depth (H, W) float32 [m], checked; 0 if not measured."""
    source = f"the unit of `{name}`"
    if name.endswith(".npy"):
        depth = metres(ctx, data, name)
        _check_depth(ctx, depth, name, options)
    else:
        scale, bits = depth_scale(ctx, facts), bits_of(ctx, data, name)
        values = counts(ctx, data, name)
        depth = np.where(values == SATURATED, 0.0, values * scale).astype(np.float32)
        _check_depth(ctx, depth, name, options, bits)
        doubts.of_steps(ctx, values, scale, name, bits)
        source = f"`depth_scale_m` {scale:g}"
    doubts.of_depth(ctx, depth, source)
    doubts.of_gaps(ctx, depth)
    doubts.of_noise(ctx, depth)
    return depth


def _check_depth(ctx: Context, depth: np.ndarray, name: str, options: FolderOptions, bits: int = 16) -> None:
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
            **({"bits": "8, which hold 255 depths at most"} if bits == 8 else {}),
            hint=_unit_hint(name, bits),
        )


def _unit_hint(name: str, bits: int) -> str:
    if name.endswith(".npy"):
        return f"`{name}` holds metres: divide millimetres by 1000"
    if bits == 8:
        return f"write `{name}` with 16 bit, as the camera gives it: it was reduced to 8 bit, perhaps for viewing"
    return f"check `depth_scale_m` in `{NAME}`: metres per count, 0.001 for 16 bit millimetres"

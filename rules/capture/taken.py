"""A picture of a capture's folder with its depth: rotated upright, rectified, checked."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from pydantic import PositiveFloat

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.cameras.camera import Camera, Capture, Measured, Photograph
from dextera_build.artifacts.cameras.image import DepthImage, Image
from dextera_build.rule import Context, Options

from . import doubts, exif
from .facts import NAME, depth_scale, gravity_of
from .intrinsics import lens_of
from .pictures import bits_of, counts, metres, pixels, size
from .pinhole import Lens, nearest, pinhole, places, smooth

SATURATED = 65535  # written by many drivers for missing returns


class DepthOptions(Options):
    """Options of rules that read captures."""

    nearest_m: PositiveFloat = 0.1
    """Minimum accepted median depth [m]."""
    farthest_m: PositiveFloat = 20.0
    """Maximum accepted median depth [m]."""


class Lenses:
    """The lens of a folder's pictures, with the positions of its pixels, which are computed once.

    Args:
        ctx: Context for errors and warnings.
        folder: The capture's files.
        facts: Content of `capture.json`.
    """

    def __init__(self, ctx: Context, folder: Folder, facts: Mapping[str, object]) -> None:
        self._ctx, self._folder, self._facts = ctx, folder, facts
        self._lens: Camera | Lens | None = None
        self._places: np.ndarray | None = None

    def of(self, tags: exif.Exif) -> Camera | Lens:
        """The intrinsics; those of the EXIF only if no file gives any."""
        if self._lens is None:
            self._lens = lens_of(self._ctx, self._folder, self._facts, tags)
            camera = self._lens if isinstance(self._lens, Camera) else pinhole(self._lens)
            doubts.of_camera(self._ctx, camera)
        return self._lens

    def places(self, lens: Lens) -> np.ndarray:
        """Position of each pixel of the pinhole camera in the distorted picture, see `pinhole.places`."""
        if self._places is None:
            self._places = places(lens)
        return self._places


class Taken(NamedTuple):
    """A picture and how it was read."""

    capture: Capture
    turned: bool
    """Whether it was rotated by its EXIF orientation."""


def take(
    ctx: Context,
    folder: Folder,
    facts: Mapping[str, object],
    lenses: Lenses,
    names: tuple[str, str | None],
    options: DepthOptions,
    *,
    doubted: bool = True,
) -> Taken:
    """Read one picture.

    Args:
        ctx: Context for errors and warnings.
        folder: The capture's files.
        facts: Content of `capture.json`, with the scale of the depth.
        lenses: The camera of all pictures of the folder.
        names: Files of the picture and of its depth, or None.
        options: Limits of the depth.
        doubted: Whether to warn about implausible depth.
    """
    picture, name = names
    tags = exif.read(ctx, folder.files[picture], picture)
    lens = lenses.of(tags)
    orientation = _orientation(ctx, lens, tags, picture)
    # Everything about the depth is checked before the photograph is decoded.
    if name is not None:
        _check_same_size(ctx, size(ctx, folder.files[name], name), (lens.width, lens.height))
    rgb = exif.upright(pixels(ctx, folder.files[picture], picture, "RGB"), orientation)
    depth = None if name is None else _depth(ctx, folder.files[name], name, facts, options, doubted)
    if not isinstance(lens, Camera):
        where = lenses.places(lens)
        rgb, depth = smooth(rgb, where), None if depth is None else nearest(depth, where)
    camera = lens if isinstance(lens, Camera) else pinhole(lens)
    gravity = gravity_of(ctx, facts)
    measured = None if depth is None else Measured(depth=DepthImage(depth=depth))
    if depth is not None and doubted:
        doubts.of_registration(ctx, rgb, depth)
    photograph = Photograph(rgb=Image(pixels=rgb), camera=camera, gravity=gravity)
    return Taken(Capture(photograph=photograph, measured=measured), orientation > 1)


def _orientation(ctx: Context, lens: Camera | Lens, tags: exif.Exif, picture: str) -> int:
    """The rotation of the stored picture that matches the size of the intrinsics, 1 to 8."""
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
        f"`{picture}` has EXIF orientation {tags.orientation}, but the intrinsics are those of the stored picture, "
        "so it was not rotated"
    )
    return 1


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


def _depth(
    ctx: Context, data: bytes, name: str, facts: Mapping[str, object], options: DepthOptions, doubted: bool
) -> np.ndarray:
    """Depth (H, W) float32 [m], checked; 0 if not measured."""
    source = f"the unit of `{name}`"
    if name.endswith(".npy"):
        depth = metres(ctx, data, name)
        check_depth(ctx, depth, name, options)
    else:
        scale, bits = depth_scale(ctx, facts), bits_of(ctx, data, name)
        values = counts(ctx, data, name)
        depth = np.where(values == SATURATED, 0.0, values * scale).astype(np.float32)
        check_depth(ctx, depth, name, options, bits)
        if doubted:
            doubts.of_steps(ctx, values, scale, name, bits)
        source = f"`depth_scale_m` {scale:g}"
    if doubted:
        doubts.of_depth(ctx, depth, source)
        doubts.of_gaps(ctx, depth)
        doubts.of_noise(ctx, depth)
    return depth


def check_depth(
    ctx: Context, depth: np.ndarray, name: str, options: DepthOptions, bits: int = 16, *, stream: bool = False
) -> None:
    """Raise for depth (H, W) [m] of a file, or of a recording's topic, that is no depth or in another unit."""
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
            hint="a 16 bit count is a millimetre; metres are 32 bit" if stream else _unit_hint(name, bits),
        )


def _unit_hint(name: str, bits: int) -> str:
    if name.endswith(".npy"):
        return f"`{name}` holds metres: divide millimetres by 1000"
    if bits == 8:
        return f"write `{name}` with 16 bit, as the camera gives it: it was reduced to 8 bit, perhaps for viewing"
    return f"check `depth_scale_m` in `{NAME}`: metres per count, 0.001 for 16 bit millimetres"

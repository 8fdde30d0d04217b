"""capture.folder: read a photograph, with its depth if available, from a folder of files."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.cameras.camera import Capture
from dextera_build.errors import listing
from dextera_build.rule import Context, rule

from .facts import NAME, read
from .taken import DepthOptions, Lenses, take

RGB = ("rgb.png", "rgb.jpg", "rgb.jpeg")
DEPTH = ("depth.png", "depth.npy")


class FolderOptions(DepthOptions):
    """Options of capture.folder."""


@rule(version=4, packages=("pillow",))
def folder(ctx: Context, folder: Folder, *, options: FolderOptions) -> Capture:
    """Return the capture in `capture.json`, `rgb.png` or `rgb.jpg`, and, if available, `depth.png` or `depth.npy`.

    `capture.json` contains width, height, fx, fy, cx, cy [px] (OpenCV convention, integer pixel centres) and, for a
    `depth.png` of 16 bit counts, `depth_scale_m` [m per count]. Depth is image-plane z; 0 and 65535 counts are invalid.
    A `depth.npy` contains metres. `gravity`, if given, is the direction in which things fall, in the camera frame.

    A photograph is rotated by its EXIF orientation, and `distortion` (OpenCV's k1 k2 p1 p2 k3 ...) is removed. Without
    intrinsics in `capture.json`, they are read from `camera_info.yaml` or `cameras.txt`, as for `capture.file`, or from
    the focal length in the EXIF, with a warning.
    """
    picture = _one_of(ctx, folder, RGB)
    facts = read(ctx, folder.files[NAME]) if NAME in folder.files else {}
    name = next((name for name in DEPTH if name in folder.files), None)
    if name is None and "depth_scale_m" in facts:
        _one_of(ctx, folder, DEPTH)
    found, turned = take(ctx, folder, facts, Lenses(ctx, folder, facts), (picture, name), options)
    camera = found.photograph.camera
    ctx.preview(found.photograph.rgb.pixels, "photograph")
    how = f"{camera.width} x {camera.height} px" + (", rotated by its EXIF orientation" if turned else "")
    if found.measured is None:
        ctx.say(f"{how}, no depth")
        return found
    depth = found.measured.depth.depth
    valid = depth > 0
    share, middle = valid.mean(), np.median(depth[valid])
    ctx.say(f"{how}, depth on {share:.0%} of them, median {middle:.2f} m")
    return found


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

"""capture.further: the further photographs of a capture, which `capture.json` lists."""

from __future__ import annotations

import reprlib
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.cameras.further import Further, FurtherPhotographs
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import listing
from dextera_build.rule import Context, rule

from .facts import NAME, read
from .folder import RGB
from .motion import stated
from .taken import DepthOptions, Lenses, take

LIST = "photographs"
POSE = "T_first_camera"
FIELDS = ("rgb", "depth", POSE)
EXAMPLE = '`"photographs": [{"rgb": "left.png", "depth": "left_depth.png"}]`'


class FurtherOptions(DepthOptions):
    """Options of capture.further."""


class _Entry(NamedTuple):
    """One element of the list."""

    rgb: str
    depth: str
    pose: np.ndarray | None


@rule(version=1, packages=("pillow",))
def further(ctx: Context, folder: Folder, *, options: FurtherOptions) -> FurtherPhotographs:
    """Return the photographs that `capture.json` lists as `photographs`, besides `rgb.png`; none if it lists none.

    Each has the paths `rgb` and `depth`, and optionally `T_first_camera`, the pose of its camera in the frame of the
    first photograph's [m], 4 x 4, OpenCV axes. All are taken by the camera of `capture.json`; the files are read as by
    `capture.folder`.
    """
    facts = read(ctx, folder.files[NAME]) if NAME in folder.files else {}
    entries = _entries(ctx, facts, folder)
    _distinct(ctx, entries, folder)
    lenses = Lenses(ctx, folder, facts)
    items = []
    for entry in entries:
        taken = take(ctx, folder, facts, lenses, (entry.rgb, entry.depth), options, doubted=False)
        pose = None if entry.pose is None else Pose(parent="camera", child="further", matrix=entry.pose)
        items.append(Further(file=entry.rgb, capture=taken.capture, pose=pose))
    found = FurtherPhotographs(items=tuple(items))
    ctx.say(", ".join(found.facts()))
    return found


def _entries(ctx: Context, facts: Mapping[str, object], folder: Folder) -> list[_Entry]:
    told = facts.get(LIST, [])
    if not isinstance(told, list):
        ctx.fail(f"`{NAME}`: `{LIST}` must be a list", found=reprlib.repr(told), hint=f"write {EXAMPLE}")
    return [_entry(ctx, number, one, folder) for number, one in enumerate(told)]


def _entry(ctx: Context, number: int, told: object, folder: Folder) -> _Entry:
    place = f"`{NAME}`: `{LIST}[{number}]`"
    if not isinstance(told, dict):
        ctx.fail(f"{place} must be an object", found=reprlib.repr(told), hint=f"write {EXAMPLE}")
    other = [key for key in told if key not in FIELDS]
    if other:
        ctx.fail(
            f"{place} has fields that are not known",
            found=listing(other),
            known=listing(FIELDS),
            hint="all photographs are taken by the one camera of `capture.json`; leave its intrinsics out here",
        )
    if told.get("depth") is None:
        ctx.fail(
            f"{place} has no depth",
            photograph=str(told.get("rgb")),
            hint="name its depth image as `depth`; a further photograph without depth is not used, so remove it",
        )
    for key in ("rgb", "depth"):
        path = told.get(key)
        if not isinstance(path, str) or path not in folder.files:
            ctx.fail(
                f"{place}: the file of `{key}` is missing",
                wanted=reprlib.repr(path),
                here=listing(folder.files),
                hint="give paths relative to the folder of `capture.json`",
            )
    return _Entry(told["rgb"], told["depth"], _pose(ctx, place, told.get(POSE)))


def _pose(ctx: Context, place: str, told: object) -> np.ndarray | None:
    if told is None:
        return None
    try:
        return stated(told)
    except ValueError:
        ctx.fail(
            f"{place}: `{POSE}` is no rigid motion",
            found=reprlib.repr(told),
            hint="write a 4 x 4 matrix in metres that maps points of this camera to those of the first one, or leave "
            "it out: it is then found from the pictures",
        )


def _distinct(ctx: Context, entries: list[_Entry], folder: Folder) -> None:
    """Refuse a photograph that is listed twice, or is the first one: it would count its errors twice."""
    seen = {folder.files[name]: name for name in RGB if name in folder.files}
    for number, entry in enumerate(entries):
        data = folder.files[entry.rgb]
        if data in seen:
            ctx.fail(
                f"`{NAME}`: `{LIST}[{number}]` is a photograph that is there already",
                photograph=entry.rgb,
                same_as=seen[data],
                hint=f"remove it from `{LIST}`, which lists photographs besides the first one, `{RGB[0]}`",
            )
        seen[data] = entry.rgb

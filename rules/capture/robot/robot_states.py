"""State of the robot at each picture, from `views` in `capture.json`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.spatial.joints import Joints
from dextera_build.errors import listing
from dextera_build.geometry import lie, poses, transforms
from dextera_build.rule import Context

from . import fields

REACH_M = 20.0
"""Larger distances of an effector from the base are probably millimetres [m]."""
TURN = 2.0 * math.pi + 0.01
"""Longer rotation vectors are probably degrees [rad]."""


@dataclass(frozen=True)
class View:
    """One element of `views`."""

    picture: str
    """File of the picture."""
    depth: str | None
    """File of its depth."""
    effector: np.ndarray | None
    """T_base_effector (7,) position [m] and quaternion w x y z."""
    joints: Mapping[str, float] | None
    """Joint -> position [rad, m]."""
    stamp: float | None
    """Time of the picture [s]."""
    skew: float | None
    """Time to the nearest joint measurement [s]."""


def views_of(ctx: Context, facts: Mapping[str, object], folder: Folder) -> list[View]:
    """The views; the files of all pictures must exist."""
    listed = facts.get("views")
    if not isinstance(listed, list) or not listed:
        fields.wrong(ctx, "views", listed, 'a list with an object for each picture: `{"rgb": "rgb_1.png", ...}`')
    found = [_view(ctx, each, f"views[{number}]", folder) for number, each in enumerate(listed)]
    seen: dict[str, int] = {}
    for number, view in enumerate(found):
        if view.picture in seen:
            fields.wrong(
                ctx, f"views[{number}].rgb", view.picture, f"a picture that `views[{seen[view.picture]}]` lacks"
            )
        seen[view.picture] = number
    return found


def effectors_of(ctx: Context, views: Sequence[View]) -> np.ndarray | None:
    """(K, 7) poses of the effector, or None if no view has one."""
    rows = [view.effector for view in views]
    _all_or_none(ctx, rows, "T_base_ee")
    return None if rows[0] is None else np.array(rows, np.float64)


def joints_of(ctx: Context, views: Sequence[View]) -> Joints | None:
    """Joint positions, or None if no view has any; views without times get their number as time."""
    rows, stamps = [view.joints for view in views], [view.stamp for view in views]
    _all_or_none(ctx, rows, "joints")
    _all_or_none(ctx, stamps, "stamp_s")
    first = rows[0]
    if first is None:
        return None
    for number, row in enumerate(rows):
        if row is None or set(row) != set(first):
            fields.wrong(
                ctx, f"views[{number}].joints", listing(row or ()), f"the joints of `views[0]`: {listing(first)}"
            )
    times = np.arange(len(views), dtype=np.float64) if stamps[0] is None else np.array(stamps, np.float64)
    if (np.diff(times) <= 0).any():
        number = int(np.argmax(np.diff(times) <= 0)) + 1
        fields.wrong(ctx, f"views[{number}].stamp_s", float(times[number]), "later than that of the view before")
    positions = np.array([[row[name] for name in first] for row in rows if row is not None], np.float64)
    return Joints(names=tuple(first), stamps=times, positions=positions)


def skews_of(ctx: Context, views: Sequence[View]) -> np.ndarray | None:
    """(K,) times to the nearest joint measurement [s], or None."""
    rows = [view.skew for view in views]
    _all_or_none(ctx, rows, "skew_s")
    return None if rows[0] is None else np.abs(np.array(rows, np.float64))


def _all_or_none(ctx: Context, rows: Sequence[object], key: str) -> None:
    missing = [number for number, row in enumerate(rows) if row is None]
    if missing and len(missing) < len(rows):
        others = listing(f"views[{number}]" for number, row in enumerate(rows) if row is not None)
        fields.wrong(ctx, f"views[{missing[0]}].{key}", None, f"a value in every view, as in {others}")


def _view(ctx: Context, view: object, key: str, folder: Folder) -> View:
    if not isinstance(view, Mapping):
        fields.wrong(ctx, key, view, 'an object: `{"rgb": "rgb_1.png", "T_base_ee": {...}}`')
    picture = _file(ctx, view.get("rgb"), f"{key}.rgb", folder)
    depth = None if view.get("depth") is None else _file(ctx, view["depth"], f"{key}.depth", folder)
    pose, joints = view.get("T_base_ee"), view.get("joints")
    if pose is None and joints is None:
        fields.wrong(ctx, f"{key}.T_base_ee", None, "the effector's pose, or `joints`: name -> position [rad, m]")
    return View(
        picture,
        depth,
        None if pose is None else _pose(ctx, pose, f"{key}.T_base_ee"),
        None if joints is None else _joints(ctx, joints, f"{key}.joints"),
        _optional(ctx, view, key, "stamp_s"),
        _optional(ctx, view, key, "skew_s"),
    )


def _file(ctx: Context, name: object, key: str, folder: Folder) -> str:
    if not isinstance(name, str):
        fields.wrong(ctx, key, name, "the name of a file in the folder")
    if name not in folder.files:
        ctx.fail(
            f"`{name}` is missing in the capture",
            wanted=f"`{key}`",
            here=listing(folder.files),
            hint=f"put `{name}` into the capture's folder",
        )
    return name


def _pose(ctx: Context, pose: object, key: str) -> np.ndarray:
    """(7,) position and quaternion of `t_m` with `rotvec_rad` or `quat_wxyz`."""
    if not isinstance(pose, Mapping):
        fields.wrong(ctx, key, pose, 'an object: `{"t_m": [x, y, z], "rotvec_rad": [rx, ry, rz]}`')
    place = fields.numbers(pose.get("t_m"), 3)
    if place is None:
        fields.wrong(ctx, f"{key}.t_m", pose.get("t_m"), "three numbers of metres")
    if math.hypot(*place) > REACH_M:
        fields.wrong(ctx, f"{key}.t_m", place, "metres, which no robot reaches this far: divide millimetres by 1000")
    if "quat_wxyz" in pose:
        quaternion = fields.numbers(pose["quat_wxyz"], 4)
        if quaternion is None or abs(math.hypot(*quaternion) - 1.0) > 1e-3:
            fields.wrong(ctx, f"{key}.quat_wxyz", pose["quat_wxyz"], "four numbers w, x, y, z of length 1")
        length = math.hypot(*quaternion)
        return np.array([*place, *(each / length for each in quaternion)])
    vector = fields.numbers(pose.get("rotvec_rad"), 3)
    if vector is None:
        fields.wrong(ctx, f"{key}.rotvec_rad", pose.get("rotvec_rad"), "three numbers of radians")
    if math.hypot(*vector) > TURN:
        fields.wrong(ctx, f"{key}.rotvec_rad", vector, "radians, at most 6.28: divide degrees by 57.2958")
    return poses.from_matrix(transforms.rigid(lie.rotation(np.array(vector)), np.array(place)))


def _joints(ctx: Context, joints: object, key: str) -> dict[str, float]:
    if not isinstance(joints, Mapping) or not joints:
        fields.wrong(ctx, key, joints, "an object: name of a joint -> position [rad], of a sliding joint [m]")
    found = {str(name): fields.number(value) for name, value in joints.items()}
    for name, value in found.items():
        if value is None:
            fields.wrong(ctx, f"{key}.{name}", joints[name], "a number of radians, of a sliding joint of metres")
    return {name: value for name, value in found.items() if value is not None}


def _optional(ctx: Context, view: Mapping[str, object], key: str, name: str) -> float | None:
    value = view.get(name)
    if value is None:
        return None
    found = fields.number(value)
    if found is None:
        fields.wrong(ctx, f"{key}.{name}", value, "a number of seconds")
    return found

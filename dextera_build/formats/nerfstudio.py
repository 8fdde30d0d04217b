"""nerfstudio's `transforms.json` (https://docs.nerf.studio/quickstart/data_conventions.html).

Poses are world from camera in OpenGL axes (x right, y up, z back); pixels count from the image's corner, as in COLMAP.
Files of instant-ngp and of the NeRF authors (`camera_angle_x`) are read, too.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dextera_build.formats.intrinsics import Intrinsics
from dextera_build.geometry.cameras import GL_FROM_CV

_NAMES = {
    "brown_conrady": ("OPENCV", ("k1", "k2", "p1", "p2", "k3")),
    "kannala_brandt": ("OPENCV_FISHEYE", ("k1", "k2", "k3", "k4")),
    "pinhole": ("PINHOLE", ()),
    "equirectangular": ("EQUIRECTANGULAR", ()),
}
"""Lens -> name of its model, and its coefficients in the order of `Intrinsics`."""


@dataclass(frozen=True)
class Frame:
    """A picture of a `transforms.json`.

    Args:
        path: Its file, relative to the JSON file.
        lens: Its camera; None: it follows from the size of the picture and `angle_x` (`camera_angle_x`).
        pose: T_world_camera, (4, 4), OpenCV axes.
        angle_x: Horizontal field of view [rad], if the camera has no other parameters.
    """

    path: str
    lens: Intrinsics | None
    pose: np.ndarray
    angle_x: float = 0.0


def written(frames: Sequence[Frame], world: str) -> str:
    """The JSON text, with intrinsics per frame.

    Args:
        frames: The pictures.
        world: Name of the frame of the poses; an additional field.

    Raises:
        ValueError: A lens has no model here.
    """
    rows = []
    kinds = {_model(frame) for frame in frames}
    if len(kinds) > 1:
        raise ValueError(f"its cameras are of several models: {', '.join(sorted(kinds))}")
    for frame in frames:
        assert frame.lens is not None
        matrix = (frame.pose @ GL_FROM_CV).tolist()
        rows.append({"file_path": frame.path, **_lens_fields(frame.lens), "transform_matrix": matrix})
    model = next(iter(kinds), "OPENCV")
    return json.dumps({"camera_model": model, "world_frame": world, "frames": rows}, indent=1) + "\n"


def read(text: str) -> tuple[list[Frame], str]:
    """The frames of a `transforms.json`, and the name of the frame of their poses.

    Raises:
        ValueError: It is no such file, or a frame has no pose or no camera.
    """
    try:
        facts = json.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    frames = facts.get("frames") if isinstance(facts, Mapping) else None
    if not isinstance(frames, Sequence) or isinstance(frames, str):
        raise ValueError("it has no list `frames`")
    common = {name: value for name, value in facts.items() if name != "frames"}
    found = [_frame(number, common, frame) for number, frame in enumerate(frames, 1)]
    return found, str(facts.get("world_frame", "world"))


def _frame(number: int, common: Mapping[str, Any], frame: object) -> Frame:
    place = f"frame {number}"
    if not isinstance(frame, Mapping) or not isinstance(frame.get("file_path"), str):
        raise ValueError(f"{place} has no `file_path`")
    try:
        matrix = np.array(frame.get("transform_matrix"), np.float64)
    except (TypeError, ValueError):
        matrix = np.zeros(0)
    if matrix.shape not in {(4, 4), (3, 4)} or not np.isfinite(matrix).all():
        raise ValueError(f"{place} has no `transform_matrix` of 4 x 4 numbers")
    pose = np.vstack([matrix[:3], [0.0, 0.0, 0.0, 1.0]]) @ GL_FROM_CV
    fields = {**common, **frame}
    if "fl_x" not in fields and "camera_angle_x" in fields and fields.get("camera_model") != "EQUIRECTANGULAR":
        angle = _number(place, fields, "camera_angle_x")
        if not 0 < angle < math.pi:
            raise ValueError(f"{place}: `camera_angle_x` is no angle of a camera [rad]")
        return Frame(frame["file_path"], None, pose, angle)
    return Frame(frame["file_path"], _lens(place, fields), pose)


def _lens(place: str, fields: Mapping[str, Any]) -> Intrinsics:
    model = fields.get("camera_model", "OPENCV")
    kinds = {name: kind for kind, (name, _) in _NAMES.items()} | {"SIMPLE_PINHOLE": "pinhole"}
    if model not in kinds:
        raise ValueError(f"{place}: camera model `{model}` is not one of {', '.join(kinds)}")
    width, height = (_number(place, fields, name) for name in ("w", "h"))
    if width < 1 or height < 1 or not width.is_integer() or not height.is_integer():
        raise ValueError(f"{place}: the image is {width:g} x {height:g} px")
    size = int(width), int(height)
    if kinds[model] == "equirectangular":
        return Intrinsics("equirectangular", *size)
    fx = _number(place, fields, "fl_x")
    fy = _number(place, fields, "fl_y") if "fl_y" in fields else fx
    centre = (_number(place, fields, "cx") - 0.5, _number(place, fields, "cy") - 0.5)
    known = {name: _number(place, fields, name) for name in ("k1", "k2", "k3", "k4", "p1", "p2") if name in fields}
    if kinds[model] == "kannala_brandt":
        k = tuple(known.get(name, 0.0) for name in ("k1", "k2", "k3", "k4"))
        return Intrinsics("kannala_brandt", *size, (fx, fy), centre, k)
    if known.get("k4"):
        raise ValueError(f"{place}: k4 is the eighth power of the radius here, for which there is no lens")
    if kinds[model] == "pinhole" or not any(known.values()):
        return Intrinsics("pinhole", *size, (fx, fy), centre)
    k = tuple(known.get(name, 0.0) for name in ("k1", "k2", "p1", "p2", "k3"))
    return Intrinsics("brown_conrady", *size, (fx, fy), centre, (*k, 0.0, 0.0, 0.0))


def _model(frame: Frame) -> str:
    assert frame.lens is not None
    name, _ = _NAMES[frame.lens.model]
    # A pinhole is an `OPENCV` camera without distortion, so both may be in one file.
    return "OPENCV" if name == "PINHOLE" else name


def _lens_fields(lens: Intrinsics) -> dict[str, object]:
    size = {"w": lens.width, "h": lens.height}
    if lens.model == "equirectangular":
        # nerfstudio requires a focal length, but does not use it.
        return {**size, "fl_x": lens.width / 2, "fl_y": lens.height, "cx": lens.width / 2, "cy": lens.height / 2}
    names = _NAMES[lens.model][1]
    if any(lens.coefficients[len(names) :]):
        raise ValueError("it has no place for the denominator of the rational model (k4, k5, k6)")
    place = {"cx": lens.centre[0] + 0.5, "cy": lens.centre[1] + 0.5}
    return {
        **size,
        "fl_x": lens.focal[0],
        "fl_y": lens.focal[1],
        **place,
        **dict(zip(names, lens.coefficients, strict=False)),
    }


def _number(place: str, fields: Mapping[str, Any], name: str) -> float:
    value = fields.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{place}: `{name}` is no finite number")
    return float(value)

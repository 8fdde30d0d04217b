"""`capture.json`: camera and depth scale of a capture, parsed as untrusted data."""

from __future__ import annotations

import json
import math
import reprlib
from collections.abc import Mapping
from typing import NoReturn

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.errors import listing
from dextera_build.rule import Context

NAME = "capture.json"
INTRINSICS = ("width", "height", "fx", "fy", "cx", "cy")
VIEW = "view_deg"
"""Horizontal field of view [deg], where nothing else is known of the lens."""
_LARGEST = 1e6
"""Upper bound of the intrinsics' magnitude [px]."""
_WIDEST_DEG, _NARROWEST_DEG = 170.0, 0.5
"""Limits of a pinhole camera's field of view [deg]."""


def read(ctx: Context, data: bytes) -> Mapping[str, object]:
    """Parse the object in `capture.json`."""
    facts: object = None
    try:
        facts = json.loads(data)
        json.loads(data, parse_constant=_refuse)
    except (ValueError, RecursionError) as error:
        deep = isinstance(error, RecursionError)
        ctx.fail(
            f"`{NAME}` is not valid JSON" + (f": {_infinite(facts)}" if _infinite(facts) else ""),
            parser="nested too deeply" if deep else str(error),
            hint="write the number that the camera's driver gives; NaN and Infinity are not JSON"
            if _infinite(facts)
            else f"`python -m json.tool {NAME}` shows the place of a syntax error; NaN and Infinity are not JSON",
        )
    if not isinstance(facts, dict):
        ctx.fail(f"`{NAME}` must hold an object", found=type(facts).__name__, hint='begin it with `{"width": 640, ...`')
    return facts


def distortion_of(ctx: Context, facts: Mapping[str, object]) -> tuple[float, ...]:
    """Coefficients of the lens in OpenCV's order, k1 k2 p1 p2 k3 k4 k5 k6; empty for a pinhole camera."""
    value = facts.get("distortion", [])
    numbers = [_finite(each) for each in value] if isinstance(value, list) else [None]
    if len(numbers) not in (0, 4, 5, 8) or None in numbers:
        ctx.fail(
            f"`{NAME}`: `distortion` must be 4, 5 or 8 numbers",
            found=reprlib.repr(value),
            hint="copy OpenCV's k1, k2, p1, p2 and, if given, k3 or k3, k4, k5, k6; leave it out for a pinhole",
        )
    return tuple(number or 0.0 for number in numbers) if any(numbers) else ()


def camera_of(ctx: Context, facts: Mapping[str, object]) -> Camera:
    """The pinhole camera with these intrinsics."""
    missing = [key for key in INTRINSICS if key not in facts]
    if missing:
        ctx.fail(
            f"`{NAME}` lacks intrinsics",
            missing=listing(missing),
            here=listing(facts),
            hint="write width, height, fx, fy, cx and cy in pixels",
        )
    width, height = (_pixels(ctx, facts, key, whole=True) for key in ("width", "height"))
    fx, fy = (_pixels(ctx, facts, key) for key in ("fx", "fy"))
    cx, cy = (_pixels(ctx, facts, key, positive=False) for key in ("cx", "cy"))
    camera = Camera(width=int(width), height=int(height), fx=fx, fy=fy, cx=cx, cy=cy)
    _check_view(ctx, camera)
    return camera


def of_view(ctx: Context, facts: Mapping[str, object], size: tuple[int, int]) -> Camera:
    """The camera of a picture (width, height) with a stated field of view: square pixels, centre in the middle."""
    view = _finite(facts[VIEW])
    if view is None or not _NARROWEST_DEG <= view <= _WIDEST_DEG:
        ctx.fail(
            f"`{NAME}`: `{VIEW}` must be a horizontal field of view",
            found=reprlib.repr(facts[VIEW]),
            hint=f"write degrees between {_NARROWEST_DEG:g} and {_WIDEST_DEG:g}; phones have 60 to 75",
        )
    width, height = size
    focal = width / 2.0 / math.tan(math.radians(view) / 2.0)
    return Camera(width=width, height=height, fx=focal, fy=focal, cx=(width - 1) / 2, cy=(height - 1) / 2)


def depth_scale(ctx: Context, facts: Mapping[str, object]) -> float:
    """Metres per count of the depth image."""
    value = facts.get("depth_scale_m")
    scale = _finite(value)
    if scale is None or scale <= 0:
        ctx.fail(
            "the depth has no scale",
            depth_scale_m=f"missing in `{NAME}`" if value is None else reprlib.repr(value),
            hint=f'add `"depth_scale_m": 0.001` to `{NAME}` where one count is a millimetre',
        )
    return scale


def gravity_of(ctx: Context, facts: Mapping[str, object]) -> tuple[float, float, float] | None:
    """Unit direction in which things fall, in the camera frame; None if it is not stated."""
    value = facts.get("gravity")
    if value is None:
        return None
    numbers = [_finite(each) for each in value] if isinstance(value, list) else []
    x, y, z = (number or 0.0 for number in numbers) if len(numbers) == 3 and None not in numbers else (0.0, 0.0, 0.0)
    length = math.hypot(x, y, z)
    if length < 1e-6:
        ctx.fail(
            f"`{NAME}`: `gravity` must be three numbers",
            found=reprlib.repr(value),
            hint="write the direction in which things fall, along the camera's x (right), y (down) and z (forward); an "
            "accelerometer at rest reads the opposite",
        )
    return x / length, y / length, z / length


def _pixels(
    ctx: Context, facts: Mapping[str, object], key: str, *, whole: bool = False, positive: bool = True
) -> float:
    value = _finite(facts[key])
    if value is None or (positive and value <= 0) or (whole and not value.is_integer()):
        kind = "positive whole number" if whole else "positive number" if positive else "number"
        ctx.fail(
            f"`{NAME}`: `{key}` must be a {kind} of pixels",
            found=reprlib.repr(facts[key]),
            hint="copy the intrinsics of the colour stream from the camera's driver",
        )
    return value


def _finite(value: object) -> float | None:
    """The value if it is a number of ordinary magnitude, otherwise None."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value) if -_LARGEST < value < _LARGEST else None


def _check_view(ctx: Context, camera: Camera) -> None:
    if not (0 <= camera.cx <= camera.width and 0 <= camera.cy <= camera.height):
        ctx.fail(
            "the intrinsics do not match the image size: the principal point is outside the image",
            principal_point=f"{camera.cx:g}, {camera.cy:g} px",
            image=f"{camera.width} x {camera.height} px",
            hint="scale fx, fy, cx and cy by the factor that the image was resized by",
        )
    for key, focal, length in (("fx", camera.fx, camera.width), ("fy", camera.fy, camera.height)):
        view_deg = 2 * math.degrees(math.atan(length / (2 * focal)))
        if not _NARROWEST_DEG <= view_deg <= _WIDEST_DEG:
            ctx.fail(
                f"`{NAME}`: `{key}` is not plausible",
                focal_length=f"{focal:g} px",
                field_of_view=f"{view_deg:.4g} deg",
                plausible=f"{_NARROWEST_DEG:g} to {_WIDEST_DEG:g} deg",
                hint=f"write `{key}` in pixels: focal length / sensor size * image size, both lengths in mm",
            )


def _infinite(facts: object) -> str:
    """The keys that hold NaN or an infinite number: fx is nan."""
    if not isinstance(facts, dict):
        return ""
    numbers = {key: value if isinstance(value, list) else [value] for key, value in facts.items()}
    bad = [key for key, value in numbers.items() if any(isinstance(x, float) and not math.isfinite(x) for x in value)]
    return ", ".join(f"`{key}` is {facts[key]}" for key in bad)


def _refuse(word: str) -> NoReturn:
    raise ValueError(f"`{word}` is not a JSON number")

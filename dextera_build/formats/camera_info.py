"""ROS camera_info: the YAML file of camera_calibration, and a `sensor_msgs/CameraInfo` as `ros2 topic echo` prints it.

https://docs.ros.org/en/rolling/p/camera_calibration_parsers and sensor_msgs/msg/CameraInfo. Pixel centres are integers.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import yaml

from dextera_build.formats.intrinsics import Intrinsics, Model

_MODELS: dict[str, tuple[Model, int]] = {
    "plumb_bob": ("brown_conrady", 5),
    "rational_polynomial": ("brown_conrady", 8),
    "equidistant": ("kannala_brandt", 4),
    "fisheye": ("kannala_brandt", 4),
}
"""ROS name -> lens, and the most coefficients it has; missing ones are 0."""

_LONGEST = 1 << 18
"""Longest text that is read [characters]; a rig of ten cameras with covariances has 8,000."""
_MOST_VALUES = 100_000
"""Maximum number of values after expansion of aliases and merge keys, because a few lines can expand to billions."""


def written(lens: Intrinsics, name: str) -> str:
    """The YAML file of a camera.

    Args:
        lens: The camera.
        name: Its name.

    Raises:
        ValueError: ROS has no such model.
    """
    if lens.model == "equirectangular":
        raise ValueError("ROS has no distortion model for equirectangular images")
    (fx, fy), (cx, cy) = lens.focal, lens.centre
    kind, coefficients = _distortion(lens)
    fields = {
        "image_width": lens.width,
        "image_height": lens.height,
        "camera_name": name,
        "camera_matrix": _matrix(3, 3, [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]),
        "distortion_model": kind,
        "distortion_coefficients": _matrix(1, len(coefficients), list(coefficients)),
        "rectification_matrix": _matrix(3, 3, [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]),
        "projection_matrix": _matrix(3, 4, [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]),
    }
    return yaml.safe_dump(fields, sort_keys=False, default_flow_style=None, width=120)


def read(text: str) -> Intrinsics:
    """The camera in a camera_info file or message; rectification and projection are ignored.

    Raises:
        ValueError: It is not such a file, or its numbers make no camera.
    """
    return of(parsed(text))


def parsed(text: str) -> Mapping[str, Any]:
    """The mapping in a YAML text.

    Raises:
        ValueError: It is not YAML, contains no mapping, is too long, or has aliases that expand to too many values.
    """
    if len(text) > _LONGEST:
        raise ValueError(f"it has {len(text):,} characters, but at most {_LONGEST:,} are read")
    try:
        loader = yaml.SafeLoader(text)
        root = loader.get_single_node()
        _check_aliases(root, {})
        facts = None if root is None else loader.construct_document(root)
    except (yaml.YAMLError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        raise ValueError(f"it is not YAML{f', line {mark.line + 1}' if mark else ''}") from None
    if not isinstance(facts, Mapping):
        raise ValueError("it holds no mapping of names to values")
    return facts


def of(facts: Mapping[str, Any]) -> Intrinsics:
    """The camera that the fields of a camera_info describe.

    Raises:
        ValueError: A field is missing, or its numbers make no camera.
    """
    width, height = (_count(_field(facts, f"image_{name}", name), name) for name in ("width", "height"))
    k = numbers(_field(facts, "camera_matrix", "k", "K"), "camera_matrix", 9)
    if k[1] or k[3] or k[6] or k[7] or k[8] != 1:
        raise ValueError("its camera_matrix is not [fx 0 cx; 0 fy cy; 0 0 1]")
    kind = str(_field(facts, "distortion_model"))
    d = numbers(_field(facts, "distortion_coefficients", "d", "D"), "distortion_coefficients")
    if kind not in _MODELS and any(d):
        raise ValueError(f"its distortion model `{kind}` is not one of {', '.join(_MODELS)}")
    model, most = _MODELS.get(kind, ("pinhole", 0))
    if len(d) > most and any(d[most:]):
        raise ValueError(f"its distortion model `{kind}` takes {most} coefficients, but {len(d)} are given")
    # A fisheye lens with zeros is equidistant, not a pinhole.
    if model == "brown_conrady" and not any(d):
        model = "pinhole"
    size = {"brown_conrady": 8, "kannala_brandt": 4}.get(model, 0)
    return Intrinsics(model, width, height, (k[0], k[4]), (k[2], k[5]), (*d, *8 * [0.0])[:size])


def numbers(value: object, name: str, count: int | None = None) -> tuple[float, ...]:
    """Numbers in a list, in a list of rows, or in a mapping with `data`.

    Args:
        value: Content of the file.
        name: The field, for messages.
        count: Required number; None: any number.

    Raises:
        ValueError: They are not that many finite numbers.
    """
    if isinstance(value, Mapping):
        value = value.get("data")
    if isinstance(value, Sequence) and not isinstance(value, str) and any(isinstance(row, Sequence) for row in value):
        value = [number for row in value for number in (row if isinstance(row, Sequence) else [row])]
    if not isinstance(value, Sequence) or isinstance(value, str):
        raise ValueError(f"its {name} holds no list of numbers")
    if not all(isinstance(x, int | float) and not isinstance(x, bool) and math.isfinite(x) for x in value):
        raise ValueError(f"its {name} holds something that is no finite number")
    if count is not None and len(value) != count:
        raise ValueError(f"its {name} holds {len(value)} numbers instead of {count}")
    return tuple(float(x) for x in value)


def _check_aliases(node: Any, known: dict[Any, int]) -> int:
    """The number of values in a node; `known` contains those of other nodes."""
    if node not in known:
        known[node] = _MOST_VALUES  # recursion guard: the node may contain itself
        inner = node.value if isinstance(node, yaml.CollectionNode) else ()
        parts = [part for each in inner for part in (each if isinstance(each, tuple) else (each,))]
        known[node] = 1 + sum(_check_aliases(part, known) for part in parts)
        if known[node] > _MOST_VALUES:
            raise ValueError(
                f"its aliases stand for at least {known[node]:,} values, but at most {_MOST_VALUES:,} are read; "
                "write the values down"
            )
    return known[node]


def _distortion(lens: Intrinsics) -> tuple[str, tuple[float, ...]]:
    if lens.model == "kannala_brandt":
        return "equidistant", lens.coefficients
    full = lens.coefficients or 8 * (0.0,)
    return ("rational_polynomial", full) if any(full[5:]) else ("plumb_bob", full[:5])


def _matrix(rows: int, columns: int, data: list[float]) -> dict[str, object]:
    return {"rows": rows, "cols": columns, "data": data}


def _field(facts: Mapping[str, Any], *names: str) -> Any:
    for name in names:
        if name in facts:
            return facts[name]
    raise ValueError(f"it has no field `{names[0]}`")


def _count(value: object, name: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        raise ValueError(f"its {name} is no positive whole number")
    return value

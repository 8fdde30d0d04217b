"""Random values of every artifact type, drawn from its declared fields."""

from __future__ import annotations

import importlib
import math
import pkgutil
import types
from collections.abc import Callable, Iterator
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from pydantic import BaseModel
from scipy.spatial.transform import Rotation

import dextera_build.artifacts as package
from dextera_build.artifacts.base import Artifact, Folder
from dextera_build.artifacts.cameras.camera import Camera, Capture, Measured, Photograph
from dextera_build.artifacts.cameras.image import DepthImage, Image
from dextera_build.artifacts.core.arrays import Array
from dextera_build.artifacts.core.frames import Frames
from dextera_build.artifacts.robots.noise import ColourNoise, DepthNoise
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.scenes.room import Room
from dextera_build.artifacts.scenes.scene_description import (
    Attachment,
    BodyNode,
    Box,
    CameraNode,
    Contact,
    Geom,
    Inertia,
    JointNode,
    Light,
    Material,
    ObjectNode,
    SceneDescription,
)
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.artifacts.spatial.point_cloud import PointCloud
from dextera_build.artifacts.spatial.pose import Pose, Similarity
from dextera_build.artifacts.tasks.term import ROWS, TermSpec
from dextera_build.artifacts.tasks.trials import Operated, Trials
from tests.artifacts import generated_cameras
from tests.artifacts import generated_scenes as scenes

Draw = Callable[[st.SearchStrategy[Any]], Any]
_LETTERS = "abcdefghijklmnopqrstuvwxyz"
LABELS = st.builds(str.__add__, st.sampled_from(_LETTERS), st.text(f"{_LETTERS}0123456789_", max_size=7))
NUMBERS = st.floats(-1e6, 1e6, allow_nan=False).map(float)
PLAIN: dict[Any, st.SearchStrategy[Any]] = {
    int: st.integers(-(2**53), 2**53),
    float: NUMBERS,
    bool: st.booleans(),
    bytes: st.binary(max_size=40),
    str: st.text(st.characters(exclude_categories=["Cs", "Cc"]), max_size=12),
    type(None): st.none(),
    Any: st.none() | st.integers() | st.text(max_size=4),
}


EXTREMES = [0.0, -0.0, 1.0, -1.0, 0.1, 1e-40, 1.2e-38, -3.4e38, math.inf, -math.inf, math.nan]
"""Numbers that a conversion may lose; 1e-40 is subnormal in single precision."""


def kinds() -> list[type[Artifact]]:
    """Every artifact type that dxb defines."""
    for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
        importlib.import_module(module.name)
    found = {kind for kind in _below(Artifact) if kind.__module__.startswith(package.__name__)}
    return sorted((kind for kind in found if kind.name() != "Collection"), key=lambda kind: kind.__name__)


def _below(kind: type[Any]) -> Iterator[type[Any]]:
    for each in kind.__subclasses__():
        yield each
        yield from _below(each)


@st.composite
def values(draw: Draw, kind: type[BaseModel]) -> Any:
    """A value of an artifact type, or of a `Value`."""
    return _value(draw, kind)


def _value(draw: Draw, kind: type[BaseModel]) -> Any:
    special = SPECIAL.get(kind)
    return kind(**(_fields(draw, kind) if special is None else special(draw)))


def _fields(draw: Draw, kind: type[BaseModel]) -> dict[str, Any]:
    axes: dict[str, int] = {}
    fields = {}
    for name, info in kind.model_fields.items():
        spec = [each for each in info.metadata if isinstance(each, Array)]
        hint = Annotated[(info.annotation, spec[0])] if spec else info.annotation  # type: ignore[valid-type]
        fields[name] = _drawn(draw, hint, axes)
        for frames in (each for each in info.metadata if isinstance(each, Frames)):
            fields[name] = fields[name].model_copy(update=frames.declared)
    return fields


def _folder(draw: Draw) -> dict[str, Any]:
    return {"files": draw(st.dictionaries(LABELS.map(lambda name: f"a/{name}"), PLAIN[bytes], max_size=3))}


def _term(draw: Draw) -> dict[str, Any]:
    return _fields(draw, TermSpec) | {"term": "height", "rows": draw(st.sampled_from(ROWS))}


def _mesh(draw: Draw) -> dict[str, Any]:
    fields = _fields(draw, Mesh)
    fields["faces"] = fields["faces"] % len(fields["vertices"])
    if fields["uv"] is None or fields["texture"] is None:
        fields["uv"] = fields["texture"] = None
    return fields


def _photograph(draw: Draw) -> dict[str, Any]:
    rgb, camera = draw(values(Image)), draw(values(Camera))
    height, width = rgb.pixels.shape[:2]
    return {"rgb": rgb, "camera": camera.model_copy(update={"width": width, "height": height})}


def _capture(draw: Draw) -> dict[str, Any]:
    photograph = draw(values(Photograph))
    depth = draw(arrays.arrays(np.float32, photograph.rgb.pixels.shape[:2], elements=st.floats(0, 9, width=32)))
    measured = draw(st.sampled_from([None, Measured(depth=DepthImage(depth=depth))]))
    return {"photograph": photograph, "measured": measured}


def _pose(draw: Draw) -> dict[str, Any]:
    turn, shift = (np.array(draw(st.tuples(*3 * [st.floats(-10, 10)]))) for _ in range(2))
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(turn).as_matrix()
    matrix[:3, 3] = shift
    spread = draw(st.none() | arrays.arrays(np.float64, (6, 6), elements=st.floats(-1, 1)))
    covariance = None if spread is None else spread @ spread.T
    stamp = draw(st.none() | NUMBERS)
    return {"parent": draw(LABELS), "child": draw(LABELS), "matrix": matrix, "covariance": covariance, "stamp": stamp}


def _similarity(draw: Draw) -> dict[str, Any]:
    fields = _pose(draw)
    covariance = fields["covariance"]
    wider = None if covariance is None else np.pad(covariance, (0, 1))
    return fields | {"scale": draw(st.floats(1e-3, 1e3)), "covariance": wider}


def _point_cloud(draw: Draw) -> dict[str, Any]:
    fields = _fields(draw, PointCloud)
    if fields["normals"] is not None:
        axis = draw(arrays.arrays(np.int64, len(fields["points"]), elements=st.integers(0, 3)))
        fields["normals"] = np.eye(4, 3, dtype=np.float32)[axis]
    attributes = {f"_{name}": numbers for name, numbers in fields["attributes"].items()}
    return fields | {"frame": draw(LABELS), "attributes": attributes}


def _splats(draw: Draw) -> dict[str, Any]:
    count, degree = draw(st.integers(1, 4)), draw(st.integers(0, 3))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    fields = {
        "means": random.normal(size=(count, 3)),
        "rotations": Rotation.random(count, rng=random).as_quat(scalar_first=True),
        "scales": np.exp(random.normal(-4, 2, (count, 3))),
        "opacities": random.uniform(0, 1, count),
        "harmonics": random.normal(size=(count, (degree + 1) ** 2, 3)),
    }
    return {name: array.astype(np.float32) for name, array in fields.items()} | {"frame": draw(st.just("") | LABELS)}


def _room(draw: Draw) -> dict[str, Any]:
    fields = _fields(draw, Room)
    points = fields["points"].model_copy(update={"frame": fields["splats"].frame})
    return fields | {"points": points}


def _attachment(draw: Draw) -> dict[str, Any]:
    return {"prefix": "robot/", "robot": draw(values(RobotModel)), "pose": scenes.pose(draw, "world", "base")}


def _operated(draw: Draw) -> dict[str, Any]:
    trials = draw(values(Trials))
    return {"twin": trials, "world": trials, "cell": draw(st.sampled_from([None, trials]))}


SPECIAL: dict[type[BaseModel], Callable[[Draw], dict[str, Any]]] = {
    # Its numbers are those of a sensor, with bounds.
    DepthNoise: lambda draw: {"smear": draw(st.floats(0, 1)), "correlation_px": draw(st.integers(1, 9))},
    ColourNoise: lambda draw: {"sigma": draw(st.floats(0, 1)), "vignetting": draw(st.floats(0, 1))},
    Folder: _folder,
    Mesh: _mesh,
    Capture: _capture,
    Photograph: _photograph,
    Pose: _pose,
    Similarity: _similarity,
    TermSpec: _term,
    **generated_cameras.SPECIAL,
    PointCloud: _point_cloud,
    Splats: _splats,
    Room: _room,
    Operated: _operated,
    Material: scenes.material,
    Contact: scenes.contact,
    Box: scenes.box,
    Geom: scenes.geom,
    Inertia: scenes.inertia,
    BodyNode: scenes.body,
    JointNode: scenes.joint,
    ObjectNode: scenes.thing,
    Light: scenes.light,
    CameraNode: scenes.camera,
    Attachment: _attachment,
    SceneDescription: scenes.scene,
}
"""Types whose fields depend on one another."""


def _drawn(draw: Draw, hint: Any, axes: dict[str, int]) -> Any:
    origin, inner = get_origin(hint), get_args(hint)
    if hint in PLAIN:
        return draw(PLAIN[hint])
    if origin in (Union, types.UnionType):
        return _drawn(draw, draw(st.sampled_from(inner)), axes)
    if origin is Annotated:
        spec = next((each for each in inner[1:] if isinstance(each, Array)), None)
        drawn = _drawn(draw, inner[0], axes) if spec is None else _array(draw, spec, axes)
        for frames in (each for each in inner[1:] if isinstance(each, Frames)):
            drawn = drawn.model_copy(update=frames.declared)
        return drawn
    if origin is Literal:
        return draw(st.sampled_from(inner))
    if origin is dict:
        return {label: _drawn(draw, inner[1], axes) for label in draw(st.lists(LABELS, max_size=3, unique=True))}
    if origin in (tuple, list):
        repeats = origin is list or inner[-1] is Ellipsis
        return tuple(_drawn(draw, part, axes) for part in (inner[:1] * draw(st.integers(0, 3)) if repeats else inner))
    return _value(draw, hint)


def _array(draw: Draw, spec: Array, axes: dict[str, int]) -> np.ndarray:
    def size(axis: str) -> int:
        if axis.isdigit():
            return int(axis)
        return draw(st.integers(0, 4)) if axis == "*" else axes.setdefault(axis, draw(st.integers(1, 4)))

    *axes_named, last = spec.shape.split()
    rest = draw(st.sampled_from([[], ["*"], ["*", "*"]])) if last == "..." else [last]
    return _numbers(draw, np.dtype(spec.dtype), tuple(map(size, (*axes_named, *rest))), finite=spec.finite)


def _numbers(draw: Draw, dtype: np.dtype, shape: tuple[int, ...], *, finite: bool) -> np.ndarray:
    """An array of any bits and of extremes, drawn as bytes: to draw number by number took most of the time."""
    count = math.prod(shape)
    which = np.frombuffer(draw(st.binary(min_size=count, max_size=count)), np.uint8)
    bits = draw(st.binary(min_size=count * dtype.itemsize, max_size=count * dtype.itemsize))
    if dtype.kind == "b":
        return (which > 127).reshape(shape)
    known = np.array(EXTREMES if dtype.kind == "f" else [0, 1, np.iinfo(dtype).min, np.iinfo(dtype).max], dtype)
    found = np.where(which > 127, known[which % len(known)], np.frombuffer(bits, dtype))
    return np.where(np.isfinite(found) | (not finite), found, dtype.type(0)).reshape(shape)

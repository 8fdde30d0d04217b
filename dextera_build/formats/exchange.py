"""Values as JSON and files in standard formats, for programs without dxb.

Plain JSON values are unchanged, and

    {"type": "Image", "file": "photo.png"}       a type with a file format: PNG, GLB, PLY, ZIP
    {"type": "Pose", "fields": {...}}              any other artifact, `Value`, dataclass or named tuple
    {"type": "array", "file": "mask.npy"}        an array: NPY, never with pickled objects
    {"type": "bytes", "file": "data"}            bytes, and the content of a `File`
    {"type": "map", "items": {...}}                a dict

Files are named relative to the folder of the message. `read` is given the expected type, so that a message cannot
select a type that its reader did not declare.
"""

from __future__ import annotations

import dataclasses
import json
import math
import re
import stat
import types
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
from pydantic import BaseModel, TypeAdapter, ValidationError

from dextera_build.artifacts.base import Artifact, File, Folder
from dextera_build.artifacts.cameras.image import Image, png
from dextera_build.artifacts.cameras.mask_track import MaskTrack
from dextera_build.artifacts.core.arrays import Array, check_array
from dextera_build.artifacts.core.content import SMALL
from dextera_build.artifacts.core.labels import path_fault
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.artifacts.spatial.point_cloud import PointCloud
from dextera_build.errors import ArtifactError
from dextera_build.formats import mask_track, point_cloud, splats_ply

_SUFFIXES: dict[type[Artifact], str] = {
    Image: ".png",
    MaskTrack: ".zip",
    Mesh: ".glb",
    PointCloud: ".ply",
    Splats: ".ply",
}
"""Types that are written as one file -> the suffix."""
_PICTURES = ("PNG", "JPEG", "TIFF", "WEBP", "BMP")
_PIXELS = 1 << 28


def write(value: Any, folder: Path, name: str = "value") -> Any:
    """A value as JSON; its files are written to `folder`, named after `name`.

    Raises:
        ArtifactError: Its type has no external form.
    """
    return _Writer(folder).put(value, name)


def read(raw: Any, hint: Any, folder: Path) -> Any:
    """The value of type `hint` in a message; its files are in `folder`.

    Raises:
        ArtifactError: It is no such value, or one of its files is missing, damaged or outside the folder.
    """
    return _Reader(folder).get(raw, hint, "output")


def has_form(hint: Any, holders: frozenset[Any] = frozenset()) -> bool:
    """Whether values of a type can be written and read: data, rather than objects with behaviour.

    Args:
        hint: The type.
        holders: Types of which it is a part; a type that holds itself, as views hold further views, ends with them.
    """
    if hint in (Any, None, type(None), np.ndarray, bytes, Path, bool, int, float, str) or _is(hint, File | Folder):
        return True
    origin = get_origin(hint)
    if origin is Literal or origin is np.ndarray:
        return True
    if origin is Annotated:
        return any(isinstance(each, Array) for each in get_args(hint)[1:]) or has_form(get_args(hint)[0], holders)
    if origin is not None:
        known = origin in (Union, types.UnionType) or _is(origin, Mapping) or _is(origin, Iterable)
        return known and all(has_form(inner, holders) for inner in get_args(hint) if inner is not Ellipsis)
    if hint in holders:
        return True
    fields = _fields(hint)
    return fields is not None and all(has_form(part, holders | {hint}) for part in fields.values())


class _Writer:
    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._count = 0

    def put(self, value: Any, name: str) -> Any:
        if value is None or isinstance(value, bool | int | str):
            return value
        if isinstance(value, float | np.floating):
            if not math.isfinite(value):
                raise _wrong(name, "JSON has no form for a number that is not finite")
            return float(value)
        if isinstance(value, np.integer | np.bool_):
            return value.item()
        if isinstance(value, np.ndarray):
            path = self._path(name, ".npy")
            np.save(path, value, allow_pickle=False)
            return {"type": "array", "file": path.name}
        if isinstance(value, bytes):
            path = self._path(name, "")
            path.write_bytes(value)
            return {"type": "bytes", "file": path.name}
        return self._structure(value, name)

    def _structure(self, value: Any, name: str) -> Any:
        if isinstance(value, Path):
            return str(value)
        if isinstance(value, Mapping):
            return {"type": "map", "items": {str(key): self.put(item, f"{name}.{key}") for key, item in value.items()}}
        if isinstance(value, Artifact):
            return self._artifact(value, name)
        if isinstance(value, BaseModel):
            parts: Iterable[tuple[str, Any]] = [(each, getattr(value, each)) for each in type(value).model_fields]
        elif hasattr(value, "_asdict"):
            parts = value._asdict().items()
        elif dataclasses.is_dataclass(value):
            parts = [(each.name, getattr(value, each.name)) for each in dataclasses.fields(value)]
        elif isinstance(value, list | tuple | Iterator):
            return [self.put(item, f"{name}.{place}") for place, item in enumerate(value)]
        else:
            raise _wrong(name, f"a {type(value).__name__} has no form outside")
        kind = type(value).__name__.split("[")[0]
        return {"type": kind, "fields": {each: self.put(part, f"{name}.{each}") for each, part in parts}}

    def _artifact(self, value: Artifact, name: str) -> Any:
        if isinstance(value, File):
            path = self._path(name, "")
            value.place(path)
            return {"type": value.name(), "file": path.name}
        if isinstance(value, Folder):
            path = self._path(name, "")
            path.mkdir()
            value.export(path, "")
            return {"type": value.name(), "folder": path.name}
        suffix = _SUFFIXES.get(type(value))
        if suffix is None:
            parts = {each: self.put(getattr(value, each), f"{name}.{each}") for each in type(value).model_fields}
            return {"type": value.name(), "fields": parts}
        path = self._path(name, suffix)
        if isinstance(value, Image):
            path.write_bytes(png(value.pixels))
        else:
            _module(type(value)).save(value, path)
        return {"type": value.name(), "file": path.name}

    def _path(self, name: str, suffix: str) -> Path:
        stem = re.sub("[^A-Za-z0-9_.-]", "_", name)[-60:].lstrip(".")
        while (path := self._folder / f"{stem}{f'-{self._count}' if self._count else ''}{suffix}").exists():
            self._count += 1
        return path


class _Reader:
    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def get(self, raw: Any, hint: Any, name: str) -> Any:
        origin, inner = get_origin(hint), get_args(hint)
        if origin in (Union, types.UnionType):
            return self._either(raw, inner, name)
        if origin is Annotated:
            spec = next((each for each in inner[1:] if isinstance(each, Array)), None)
            return self._array(raw, spec, name) if spec is not None else self.get(raw, inner[0], name)
        if hint is np.ndarray or origin is np.ndarray:
            return self._array(raw, None, name)
        if hint is bytes:
            return self._file(raw, ("bytes", "File"), name).read_bytes()
        if origin is not None and _is(origin, Mapping):
            items = self._tagged(raw, "map", "items", name)
            return {key: self.get(item, inner[1], f"{name}.{key}") for key, item in items.items()}
        if origin is not None and _is(origin, Iterable):
            return self._sequence(raw, origin, inner, name)
        return self._made(raw, hint, name)

    def _made(self, raw: Any, hint: Any, name: str) -> Any:
        """A value of a class, or a plain one."""
        if _is(hint, Artifact):
            return self._artifact(raw, hint, name)
        fields = _fields(hint)
        if fields is not None:
            return self._with_fields(raw, hint, fields, name)
        try:
            return TypeAdapter(hint).validate_json(json.dumps(raw), strict=True)
        except (ValidationError, ValueError) as error:
            first = error.errors(include_url=False)[0]["msg"] if isinstance(error, ValidationError) else str(error)
            raise _wrong(name, first) from None

    def _either(self, raw: Any, choices: tuple[Any, ...], name: str) -> Any:
        if raw is None and type(None) in choices:
            return None
        kind = raw.get("type") if isinstance(raw, dict) else None
        named = [hint for hint in choices if kind is not None and _type_name(hint) == kind]
        errors = []
        # A number is read as spelled: 1.0 would also fit `int`.
        for hint in named or sorted(choices, key=lambda hint: hint is not type(raw)):
            try:
                return self.get(raw, hint, name)
            except ArtifactError as error:
                errors.append(error)
        raise errors[0]

    def _sequence(self, raw: Any, origin: Any, inner: tuple[Any, ...], name: str) -> Any:
        if not isinstance(raw, list):
            raise _wrong(name, "a list is needed")
        fixed = origin is tuple and inner[-1:] != (Ellipsis,)
        if fixed and len(inner) != len(raw):
            raise _wrong(name, f"{len(inner)} items are needed, {len(raw)} came")
        kinds = inner if fixed else inner[:1] * len(raw)
        made = [
            self.get(item, kind, f"{name}.{place}") for place, (item, kind) in enumerate(zip(raw, kinds, strict=True))
        ]
        return made if origin is list else iter(made) if origin is Iterator else tuple(made)

    def _artifact(self, raw: Any, kind: type[Artifact], name: str) -> Artifact:
        if issubclass(kind, File):
            return kind.of(self._file(raw, ("bytes", kind.name()), name))
        if issubclass(kind, Folder):
            return kind(files=dict(self._tree(raw, kind.name(), name)))
        if isinstance(raw, dict) and "file" in raw and kind in _SUFFIXES:
            path = self._file(raw, (kind.name(),), name)
            try:
                made: Artifact = _loader(kind)(path)
            except ArtifactError as error:
                raise _wrong(name, str(error.facts.get("why", error.message)), path.name) from None
            return made
        found: Artifact = self._with_fields(raw, kind, _fields(kind) or {}, name)
        return found

    def _with_fields(self, raw: Any, kind: Any, fields: Mapping[str, Any], name: str) -> Any:
        given = self._tagged(raw, _type_name(kind), "fields", name)
        if unknown := sorted(given.keys() - fields.keys()):
            raise _wrong(name, f"{_type_name(kind)} has no field `{unknown[0]}`")
        parts = {each: self.get(given[each], fields[each], f"{name}.{each}") for each in given}
        try:
            return kind(**parts)
        except ArtifactError as error:
            raise _wrong(name, error.message) from None
        except (ValidationError, TypeError, ValueError) as error:
            first = error.errors(include_url=False)[0]["msg"] if isinstance(error, ValidationError) else str(error)
            raise _wrong(name, first) from None

    def _array(self, raw: Any, spec: Array | None, name: str) -> np.ndarray:
        path = self._file(raw, ("array",), name)
        try:
            # Mapping a file first compares its size with the declared shape.
            found = np.load(path, mmap_mode="r", allow_pickle=False)
            if not isinstance(found, np.ndarray):
                raise ValueError("it holds several arrays")
            found = np.asarray(found) if found.nbytes > SMALL else np.array(found)
        except (OSError, ValueError, EOFError, TypeError) as error:
            raise _wrong(name, f"it cannot be read as NPY: {error}", path.name) from None
        if spec is not None:
            check_array(name, name, found, spec, {})
        elif found.dtype.kind == "f" and not np.isfinite(found).all():
            raise _wrong(name, "some of its numbers are not finite", path.name)
        return found

    def _tagged(self, raw: Any, kind: str, part: str, name: str) -> Mapping[str, Any]:
        if not isinstance(raw, dict) or raw.keys() != {"type", part} or raw["type"] != kind:
            raise _wrong(name, f'{{"type": "{kind}", "{part}": ...}} is needed here')
        found = raw[part]
        if not isinstance(found, dict):
            raise _wrong(name, f"`{part}` is no object")
        return found

    def _file(self, raw: Any, kinds: tuple[str, ...], name: str) -> Path:
        path = self._place(raw, kinds, "file", name)
        if not stat.S_ISREG(path.lstat().st_mode):
            raise _wrong(name, "it is no plain file", path.name)
        return path

    def _tree(self, raw: Any, kind: str, name: str) -> Iterator[tuple[str, bytes]]:
        root = self._place(raw, (kind,), "folder", name)
        for path in sorted(root.rglob("*")):
            mode = path.lstat().st_mode
            if stat.S_ISREG(mode):
                yield path.relative_to(root).as_posix(), path.read_bytes()
            elif not stat.S_ISDIR(mode):
                raise _wrong(name, "it is no plain file", path.relative_to(self._folder).as_posix())

    def _place(self, raw: Any, kinds: tuple[str, ...], part: str, name: str) -> Path:
        """The path of a file named in a message: inside its folder, and not through a link."""
        if not isinstance(raw, dict) or raw.keys() != {"type", part} or raw["type"] not in kinds:
            raise _wrong(name, f'{{"type": "{kinds[0]}", "{part}": ...}} is needed here')
        said = str(raw[part])
        if fault := path_fault(said):
            raise _wrong(name, fault, said)
        path = self._folder / said
        if path.resolve() != self._folder.resolve() / said:
            raise _wrong(name, "a link leads out of the folder of the response", said)
        if not path.exists():
            raise _wrong(name, f"there is no such {part}", said)
        return path


def _loader(kind: type[Artifact]) -> Callable[[Path], Any]:
    return _picture if kind is Image else _module(kind).load


def _module(kind: type[Artifact]) -> Any:
    """The format of a type of `_SUFFIXES` other than `Image`."""
    if kind is Mesh:
        from dextera_build.formats import mesh as mesh_files  # needs trimesh for most formats

        return mesh_files
    return {MaskTrack: mask_track, PointCloud: point_cloud, Splats: splats_ply}[kind]


def _picture(path: Path) -> Image:
    from PIL import Image as Pillow

    try:
        with Pillow.open(path, formats=_PICTURES) as opened:
            if opened.width * opened.height > _PIXELS:
                raise ValueError(f"{opened.width} x {opened.height} pixels are too many")
            return Image(pixels=np.array(opened.convert("RGB")))
    except (OSError, SyntaxError, ValueError, Pillow.DecompressionBombError) as error:
        raise ArtifactError(f"it cannot be read as a picture: {error}", code="DXB-A402") from None


def _fields(kind: Any) -> dict[str, Any] | None:
    """Field -> its type, of a class with fields; None for another."""
    if _is(kind, BaseModel):
        infos = kind.model_fields.items()
        return {
            name: Annotated[info.annotation, *info.metadata] if info.metadata else info.annotation
            for name, info in infos
        }
    if _is(kind, tuple) and hasattr(kind, "_fields"):
        return get_type_hints(kind, include_extras=True)
    if dataclasses.is_dataclass(kind):
        hints = get_type_hints(kind, include_extras=True)
        return {each.name: hints[each.name] for each in dataclasses.fields(kind)}
    return None


def _type_name(hint: Any) -> str:
    """The word for a type in messages."""
    origin = get_origin(hint) or hint
    if origin is Annotated:
        return "array" if any(isinstance(each, Array) for each in get_args(hint)) else _type_name(get_args(hint)[0])
    if origin is np.ndarray:
        return "array"
    if _is(origin, Mapping):
        return "map"
    return str(getattr(origin, "__name__", origin)).split("[")[0]


def _is(kind: Any, wanted: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, wanted)


def _wrong(name: str, why: str, file: str = "") -> ArtifactError:
    return ArtifactError(
        f"`{name}` is invalid: {why}",
        code="DXB-B376",
        facts={"file": file} if file else {},
        hint="docs/outside.md describes the form of every value",
    )

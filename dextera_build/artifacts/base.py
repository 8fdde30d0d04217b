"""What every artifact is: a frozen, validated value that is stored as a canonical JSON header and blobs.

The header is `{"artifact": <type name>, "fields": {...}}`. Inside `fields`, plain JSON stands for itself and

    {"$array": [dtype, [shape], digest]}   an array; its blob is little-endian, C order
    {"$bytes": [digest, size]}             raw bytes
    {"$ref": digest}                       another artifact, by the digest of its header
    {"$map": {...}}                        a dict
    {"$value": {...}}                      a `Value`, stored inline

so the store and the engine can follow references without knowing any type.
"""

from __future__ import annotations

import json
import types
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, Generic, Self, TypeVar, Union, get_args, get_origin

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError, model_validator

from dextera_build import digest
from dextera_build.errors import ArtifactError

Put = Callable[[bytes], str]
Get = Callable[[str], bytes]


@dataclass(frozen=True)
class Array:
    """The declared form of an array field, used as `Annotated[np.ndarray, Array("V 3", "float32", unit="m")]`.

    Args:
        shape: Axis sizes separated by spaces: numbers, or names that must agree within one artifact.
        dtype: NumPy dtype name.
        unit: SI unit, or "" for a pure number.
        frame: The frame that coordinates are expressed in, or "".
        finite: Refuse NaN and infinities.
    """

    shape: str
    dtype: str
    unit: str = ""
    frame: str = ""
    finite: bool = True

    def describe(self) -> str:
        """`float32 (V, 3) [m] in object`."""
        unit = f" [{self.unit}]" if self.unit else ""
        frame = f" in {self.frame}" if self.frame else ""
        return f"{self.dtype} ({', '.join(self.shape.split())}){unit}{frame}"


class Value(BaseModel):
    """A small plain structure that is stored inline in the header of the artifact that holds it."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)


class Artifact(BaseModel):
    """A typed, immutable value. Subclasses declare fields; arrays carry an `Array` annotation.

    Raises:
        ArtifactError: A field has a wrong type, shape or dtype, disagrees with another field, or is not finite.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", arbitrary_types_allowed=True, use_attribute_docstrings=True)

    type_name: ClassVar[str] = ""

    def __init__(self, **fields: Any) -> None:
        try:
            super().__init__(**fields)
        except ValidationError as error:
            raise ArtifactError(_explain(type(self).name(), error), code="DXB-A101") from None

    @classmethod
    def name(cls) -> str:
        """The type's name in headers and messages; a generic's parameters are left out."""
        return cls.__name__.split("[")[0]

    @model_validator(mode="after")
    def _check_arrays(self) -> Self:
        axes: dict[str, tuple[str, int]] = {}
        for name, spec in array_specs(type(self)).items():
            value = getattr(self, name)
            if value is not None:
                _check_array(f"{self.name()}.{name}", name, value, spec, axes)
        return self

    def encode(self, put: Put) -> str:
        """Store this value through `put(bytes) -> digest` and return the digest of its header."""
        fields = {name: _encode(getattr(self, name), put) for name in type(self).model_fields}
        return put(digest.canonical({"artifact": self.name(), "fields": fields}))

    @classmethod
    def decode(cls, key: str, get: Get) -> Self:
        """Load the value whose header has digest `key` through `get(digest) -> bytes`.

        Raises:
            ArtifactError: The header holds another type, or what it holds is not valid.
        """
        header = json.loads(get(key))
        if header["artifact"] != cls.name():
            raise ArtifactError(f"a {cls.name()} is needed here, but a {header['artifact']} came", code="DXB-A102")
        hints = {name: info.annotation for name, info in cls.model_fields.items()}
        return cls(**{name: _decode(raw, hints.get(name), get) for name, raw in header["fields"].items()})

    def export(self, folder: Path, stem: str) -> list[Path]:
        """Write this value to `folder` in the formats that people open, and return the files, the main one first.

        The default writes every field that is an artifact into its own files, and the rest as JSON and NPZ.
        """
        folder.mkdir(parents=True, exist_ok=True)
        arrays: dict[str, np.ndarray] = {}
        plain: dict[str, Any] = {}
        written: list[Path] = []
        for name in type(self).model_fields:
            value = getattr(self, name)
            if isinstance(value, np.ndarray):
                arrays[name] = value
            elif isinstance(value, Artifact):
                written += value.export(folder, f"{stem}.{name}")
            elif isinstance(value, dict) and value and all(isinstance(v, Artifact) for v in value.values()):
                for label, part in value.items():
                    written += part.export(folder, f"{stem}.{name}.{label}")
            else:
                plain[name] = value.model_dump(mode="json") if isinstance(value, BaseModel) else value
        if arrays:
            path = folder / f"{stem}.npz"
            np.savez(path, **arrays)  # type: ignore[arg-type]
            written.append(path)
        if plain:
            path = folder / f"{stem}.json"
            path.write_text(json.dumps(plain, indent=1, sort_keys=True, default=_plain) + "\n")
            written.insert(0, path)
        return written


T = TypeVar("T", bound=Artifact)


class Collection(Artifact, Generic[T]):
    """Labelled artifacts of one type; what `each` opens and what a group of nodes hands on."""

    items: dict[str, T]
    """Label -> artifact. The label is not part of the item: renaming one leaves the item's digest alone."""


class File(Artifact):
    """The bytes of one file; its name is not part of it."""

    data: bytes
    """Content."""

    def export(self, folder: Path, stem: str) -> list[Path]:
        """Write `folder/stem`."""
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / stem
        path.write_bytes(self.data)
        return [path]


class Folder(Artifact):
    """A tree of files: relative POSIX path -> content."""

    files: dict[str, bytes]
    """Relative POSIX path -> content."""

    def export(self, folder: Path, stem: str) -> list[Path]:
        """Write the tree below `folder`; the first path is the file that stands highest and first by name."""
        written = []
        for name in sorted(self.files, key=lambda path: (path.count("/"), path)):
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(self.files[name])
            written.append(path)
        return written


@cache
def array_specs(kind: type[BaseModel]) -> dict[str, Array]:
    """Field -> declared array form, for the array fields of `kind`."""
    return {
        name: spec
        for name, info in kind.model_fields.items()
        for spec in (_array_in(info.annotation, info.metadata),)
        if spec is not None
    }


def schema_digest(annotation: Any) -> str:
    """Digest of a type's structure: names, field types and array forms, through all artifacts that it refers to."""
    return digest.of_value(_schema(annotation, ()))


def _array_in(annotation: Any, metadata: list[Any]) -> Array | None:
    for spec in metadata:
        if isinstance(spec, Array):
            return spec
    for part in get_args(annotation):
        if get_origin(part) is Annotated:
            for spec in get_args(part)[1:]:
                if isinstance(spec, Array):
                    return spec
    return None


def _check_array(place: str, name: str, value: np.ndarray, spec: Array, axes: dict[str, tuple[str, int]]) -> None:
    if value.dtype != np.dtype(spec.dtype):
        raise ArtifactError(f"{place}: dtype is {value.dtype}, but {spec.describe()} is declared", code="DXB-A103")
    wanted = spec.shape.split()
    if value.ndim != len(wanted):
        raise ArtifactError(f"{place}: shape is {value.shape}, but {spec.describe()} is declared", code="DXB-A104")
    for axis, size in zip(wanted, value.shape, strict=True):
        first, known = axes.setdefault(axis, (name, int(axis) if axis.isdigit() else size))
        if size != known:
            source = "the type" if axis.isdigit() else first
            raise ArtifactError(f"{place}: axis {axis} is {size}, but {source} says {known}", code="DXB-A105")
    if spec.finite and value.dtype.kind == "f" and not np.isfinite(value).all():
        bad = int((~np.isfinite(value)).sum())
        raise ArtifactError(f"{place}: {bad:,} of {value.size:,} numbers are not finite", code="DXB-A106")
    value.flags.writeable = False


def _encode(value: Any, put: Put) -> Any:
    if isinstance(value, np.ndarray):
        blob = np.ascontiguousarray(value, dtype=value.dtype.newbyteorder("<"))
        return {"$array": [value.dtype.name, list(value.shape), put(blob.tobytes())]}
    if isinstance(value, bytes):
        return {"$bytes": [put(value), len(value)]}
    if isinstance(value, Artifact):
        return {"$ref": value.encode(put)}
    if isinstance(value, Value):
        return {"$value": {name: _encode(getattr(value, name), put) for name in type(value).model_fields}}
    if isinstance(value, Mapping):
        return {"$map": {str(name): _encode(item, put) for name, item in value.items()}}
    if isinstance(value, tuple | list):
        return [_encode(item, put) for item in value]
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise ArtifactError(f"a {type(value).__name__} cannot be stored in an artifact", code="DXB-A107")


def _decode(raw: Any, hint: Any, get: Get) -> Any:
    if isinstance(raw, list):
        inner = _arguments(hint)
        item = inner[0] if inner else None
        fixed = inner if inner and inner[-1] is not Ellipsis and len(inner) == len(raw) else [item] * len(raw)
        return tuple(_decode(part, kind, get) for part, kind in zip(raw, fixed, strict=True))
    if not isinstance(raw, dict):
        return raw
    ((tag, body),) = raw.items()
    if tag == "$array":
        dtype, shape, blob = body
        return np.frombuffer(get(blob), dtype=np.dtype(dtype)).reshape(shape).copy()
    if tag == "$bytes":
        return get(body[0])
    if tag == "$ref":
        return _artifact_in(hint).decode(body, get)
    if tag == "$map":
        inner = _arguments(hint)
        return {name: _decode(item, inner[1] if len(inner) == 2 else None, get) for name, item in body.items()}
    kind = _first(hint, Value)
    hints = {name: info.annotation for name, info in kind.model_fields.items()}
    return kind(**{name: _decode(item, hints.get(name), get) for name, item in body.items()})


def _choices(hint: Any) -> tuple[Any, ...]:
    if get_origin(hint) in (Union, types.UnionType):
        return tuple(part for choice in get_args(hint) for part in _choices(choice))
    if get_origin(hint) is Annotated:
        return _choices(get_args(hint)[0])
    return (hint,)


def _arguments(hint: Any) -> list[Any]:
    for choice in _choices(hint):
        if get_origin(choice) in (tuple, list, dict):
            return list(get_args(choice))
    return []


def _first(hint: Any, base: type) -> Any:
    for choice in _choices(hint):
        if isinstance(choice, type) and issubclass(choice, base):
            return choice
    raise ArtifactError(f"a stored {base.__name__} stands where {hint!r} is declared", code="DXB-A108")


def _artifact_in(hint: Any) -> type[Artifact]:
    found: type[Artifact] = _first(hint, Artifact)
    return found


def _schema(annotation: Any, seen: tuple[str, ...]) -> Any:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        if annotation.__name__ in seen:
            return annotation.__name__
        inner = (*seen, annotation.__name__)
        fields = {
            name: [_schema(info.annotation, inner), [m.describe() for m in info.metadata if isinstance(m, Array)]]
            for name, info in annotation.model_fields.items()
        }
        return [annotation.__name__, fields]
    if get_args(annotation):
        origin = getattr(get_origin(annotation), "__name__", str(get_origin(annotation)))
        return [origin, [_schema(part, seen) for part in get_args(annotation)]]
    if isinstance(annotation, Array):
        return annotation.describe()
    return getattr(annotation, "__name__", repr(annotation))


def _plain(value: Any) -> Any:
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json")
    if isinstance(value, Artifact | bytes):
        return f"<{type(value).__name__}>"
    return str(value)


def _explain(kind: str, error: ValidationError) -> str:
    first = error.errors(include_url=False)[0]
    place = ".".join(str(part) for part in first["loc"])
    return f"{kind}.{place}: {first['msg']}"

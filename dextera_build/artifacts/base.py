"""The base of all artifacts: frozen, validated values that are stored as a canonical JSON header and blobs.

The header is `{"artifact": <type name>, "fields": {...}}`. Inside `fields`, plain JSON is stored as it is, and

    {"$array": [dtype, [shape], digest]}   an array; its blob is little-endian, C order
    {"$bytes": [digest, size]}             raw bytes
    {"$ref": digest}                       another artifact, by the digest of its header
    {"$map": {...}}                        a dict
    {"$value": {...}}                      a `Value`, stored inline

so the store and the engine can follow references without knowing any type.
"""

from __future__ import annotations

import io
import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, ClassVar, Generic, Self, TypeVar

from pydantic import BaseModel, ConfigDict, PrivateAttr, ValidationError, model_validator

from dextera_build import digest
from dextera_build.artifacts import describe
from dextera_build.artifacts.arrays import Array as Array
from dextera_build.artifacts.arrays import array_bytes, array_of, check_array, is_array, save_arrays
from dextera_build.artifacts.content import SMALL, Content, Get, OnDisk, Put, Stored
from dextera_build.artifacts.hints import arguments, first
from dextera_build.artifacts.labels import check_labels, check_paths, path_fault
from dextera_build.artifacts.schema import array_specs, declared
from dextera_build.errors import ArtifactError, StoreError


class Value(BaseModel):
    """A small plain structure that is stored inline in the header of the artifact that holds it."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Artifact(BaseModel):
    """A typed, immutable value. Subclasses declare fields; arrays carry an `Array` annotation.

    Raises:
        ArtifactError: A field has a wrong type, shape or dtype, disagrees with another field, or is not finite.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", arbitrary_types_allowed=True)

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
                check_array(f"{self.name()}.{name}", name, value, spec, axes)
        return self

    def facts(self) -> Iterator[str]:
        """The main facts about this value: counts, sizes, extents, units."""
        return describe.facts({name: getattr(self, name) for name in type(self).model_fields}, array_specs(type(self)))

    def picture(self) -> bytes | None:
        """PNG bytes of this value or of the first of its parts that has a picture, for notebooks."""
        parts = (getattr(self, name) for name in type(self).model_fields)
        pictures = (part.picture() for part in parts if isinstance(part, Artifact))
        return next((found for found in pictures if found is not None), None)

    def __repr__(self) -> str:
        return describe.line(self.name(), self.facts())

    def _repr_html_(self) -> str:
        return describe.page(repr(self), self.picture())

    def encode(self, put: Put) -> str:
        """Store this value through `put(bytes) -> digest` and return the digest of its header."""
        fields = {name: _encode(getattr(self, name), put) for name in type(self).model_fields}
        return put(digest.canonical({"artifact": self.name(), "fields": fields}))

    @classmethod
    def decode(cls, key: str, get: Get) -> Self:
        """Load the value whose header has digest `key` through `get(digest) -> bytes`.

        Raises:
            ArtifactError: The header holds another type, or its content is not valid.
        """
        return cls._from_header(json.loads(get(key)), get)

    @classmethod
    def _from_header(cls, header: Mapping[str, Any], get: Get) -> Self:
        if header["artifact"] != cls.name():
            raise ArtifactError(f"a {cls.name()} is needed here, but a {header['artifact']} came", code="DXB-A102")
        kinds = declared(cls)
        made = cls.__new__(cls)
        # A subclass's own checks are for new values; they do not apply to stored ones, such as files of a project.
        Artifact.__init__(made, **{n: _decode(raw, kinds.get(n), get) for n, raw in header["fields"].items()})
        return made

    @classmethod
    def restore(cls, key: str, get: Get, folder: Path, stem: str) -> list[Path]:
        """Write the value whose header has digest `key` to `folder`, as `export` does.

        Types that can be written without being in memory override it.
        """
        return cls.decode(key, get).export(folder, stem)

    def export(self, folder: str | Path, stem: str) -> list[Path]:
        """Write this value to `folder` in common file formats, and return the files, the main one first.

        The default writes every field that is an artifact into its own files, and the rest as JSON and NPZ.
        """
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        arrays: dict[str, Any] = {}
        plain: dict[str, Any] = {}
        written: list[Path] = []
        for name in type(self).model_fields:
            value = getattr(self, name)
            if is_array(value):
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
            save_arrays(path, arrays)
            written.append(path)
        if plain:
            path = folder / f"{stem}.json"
            path.write_text(json.dumps(plain, indent=1, sort_keys=True, default=_plain) + "\n")
            written.insert(0, path)
        return written


T = TypeVar("T", bound=Artifact)


class Collection(Artifact, Generic[T]):
    """Labelled artifacts of one type; the input of `each`, and the output of a group of nodes."""

    items: dict[str, T]
    """Label -> artifact. The label is not part of the item: renaming an item does not change its digest."""

    def __init__(self, **fields: Any) -> None:
        super().__init__(**fields)
        check_labels(self.name(), self.items)

    def facts(self) -> Iterator[str]:
        """Number and type of the items, with their labels."""
        kinds = sorted({item.name() for item in self.items.values()})
        yield from describe.facts({" or ".join(kinds) or "items": self.items}, {})


_FILE = re.compile(
    rb'\{"artifact":"File","fields":\{"data":\{"\$bytes":\["([0-9a-f]{64})",(0|[1-9][0-9]{0,17})\]\}\}\}'
)
"""The spelled header of a `File`, the type that nodes read most often."""


class File(Artifact):
    """The bytes of one file; its name is not part of it.

    Large content is read when `data` is first used; `path`, `open` and `place` never hold it in memory.
    """

    data: bytes
    """Content."""

    _content: Content | None = PrivateAttr(None)

    @classmethod
    def of(cls, path: str | Path) -> Self:
        """The content of a file that no longer changes; it is read when the value is stored."""
        return cls._behind(OnDisk(Path(path)))

    @classmethod
    def _behind(cls, content: Content) -> Self:
        made: Self = cls.model_construct()  # type: ignore[call-arg, assignment]  # `data` is read on first use
        made._content = content
        return made

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            if name == "data" and self._content is not None:
                self.__dict__["data"] = self._content.read()
                return self.__dict__["data"]
            return super().__getattr__(name)

    def __eq__(self, other: object) -> bool:
        """Whether the bytes are equal."""
        return isinstance(other, File) and self.data == other.data

    def facts(self) -> Iterator[str]:
        """Its size; content outside memory is not read for it."""
        yield describe.size(len(self.data) if self._content is None else self._content.path().stat().st_size)

    def __hash__(self) -> int:
        """Hash of the bytes."""
        return hash(self.data)

    def path(self, scratch: str | Path) -> Path:
        """A read-only file with this content; content that is only in memory is written to `scratch`."""
        if self._content is not None:
            return self._content.path()
        path = Path(scratch) / digest.of_bytes(self.data)[:16]
        path.write_bytes(self.data)
        return path

    def open(self) -> BinaryIO:
        """The content as a stream."""
        return io.BytesIO(self.data) if self._content is None else self._content.path().open("rb")

    def place(self, target: str | Path) -> None:
        """Write the content to `target`, sharing blocks if the file system can."""
        target = Path(target)
        target.parent.mkdir(parents=True, exist_ok=True)
        if self._content is None:
            target.write_bytes(self.data)
        else:
            self._content.place(target)

    def encode(self, put: Put) -> str:
        """Store this value; content that is not in memory is stored in pieces."""
        content = (self.__pydantic_private__ or {})["_content"]  # attribute access takes 3 us
        if content is not None:
            blob, size = content.store(put)
        elif type(self) is File:
            blob, size = put(self.data), len(self.data)
        else:
            return super().encode(put)
        return put(digest.canonical({"artifact": self.name(), "fields": {"data": {"$bytes": [blob, size]}}}))

    @classmethod
    def decode(cls, key: str, get: Get) -> Self:
        """Load the value; large content stays in the store until its first use."""
        stored = get(key)
        known = _FILE.fullmatch(stored) if cls is File else None
        if known is not None and int(known[2]) <= SMALL:
            return cls._holding(get(known[1].decode()))
        header = json.loads(stored)
        if hasattr(get, "place") and header["artifact"] == cls.name() and list(header["fields"]) == ["data"]:
            blob, size = header["fields"]["data"]["$bytes"]
            if size > SMALL:
                return cls._behind(Stored(get, blob, size))
        return cls._from_header(header, get)

    @classmethod
    def _holding(cls, data: bytes) -> Self:
        """The value with this content, not validated: validation would take longer than the read."""
        made, note = cls.__new__(cls), object.__setattr__
        made.__dict__["data"] = data
        note(made, "__pydantic_fields_set__", {"data"})
        note(made, "__pydantic_extra__", None)
        note(made, "__pydantic_private__", {"_content": None})
        return made

    def export(self, folder: str | Path, stem: str) -> list[Path]:
        """Write `folder/stem`."""
        folder = Path(folder)
        self.place(folder / stem)
        return [folder / stem]


class Folder(Artifact):
    """A tree of files: relative POSIX path -> content."""

    files: dict[str, bytes]
    """Relative POSIX path -> content."""

    def __init__(self, **fields: Any) -> None:
        super().__init__(**fields)
        check_paths(self.name(), self.files)

    def facts(self) -> Iterator[str]:
        """Number of files, and their size."""
        yield from describe.facts({"files": self.files}, {})
        yield describe.size(sum(map(len, self.files.values())))

    def export(self, folder: str | Path, stem: str) -> list[Path]:
        """Write the tree below `folder`; the first path is the topmost file, first by name."""
        folder = Path(folder)
        written = []
        for name in sorted(self.files, key=_depth):
            path = _inside(folder, name)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(self.files[name])
            written.append(path)
        return written

    @classmethod
    def restore(cls, key: str, get: Get, folder: Path, stem: str) -> list[Path]:
        """Write the tree from the store, file by file and in parallel, without holding it in memory."""
        place = getattr(get, "place", None)
        if place is None:
            return super().restore(key, get, folder, stem)
        tree = json.loads(get(key))["fields"]["files"]["$map"]
        paths = {name: _inside(folder, name) for name in sorted(tree, key=_depth)}
        for parent in dict.fromkeys(path.parent for path in paths.values()):
            parent.mkdir(parents=True, exist_ok=True)
        from concurrent.futures import ThreadPoolExecutor  # slow to load

        with ThreadPoolExecutor() as pool:
            list(pool.map(lambda name: place(tree[name]["$bytes"][0], paths[name]), paths))
        return list(paths.values())


def _depth(name: str) -> tuple[int, str]:
    return name.count("/"), name


def _inside(folder: Path, name: str) -> Path:
    wrong = path_fault(name)
    if wrong:
        raise StoreError(f"`{name}` cannot be written below `{folder}`: {wrong}", code="DXB-S404")
    return folder / name


def _encode(value: Any, put: Put) -> Any:
    if is_array(value):
        return {"$array": [value.dtype.name, list(value.shape), put(array_bytes(value))]}
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
        inner = arguments(hint)
        item = inner[0] if inner else None
        fixed = inner if inner and inner[-1] is not Ellipsis and len(inner) == len(raw) else [item] * len(raw)
        return tuple(_decode(part, kind, get) for part, kind in zip(raw, fixed, strict=True))
    if not isinstance(raw, dict):
        return raw
    ((tag, body),) = raw.items()
    if tag == "$array":
        dtype, shape, blob = body
        return array_of(dtype, shape, get(blob))
    if tag == "$bytes":
        return get(body[0])
    if tag == "$ref":
        return _artifact_in(hint).decode(body, get)
    if tag == "$map":
        inner = arguments(hint)
        return {name: _decode(item, inner[1] if len(inner) == 2 else None, get) for name, item in body.items()}
    kind = first(hint, Value)
    kinds = declared(kind)
    return kind(**{name: _decode(item, kinds.get(name), get) for name, item in body.items()})


def _artifact_in(hint: Any) -> type[Artifact]:
    found: type[Artifact] = first(hint, Artifact)
    return found


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

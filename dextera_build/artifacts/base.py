"""The base of all artifacts: frozen, validated values that are stored as a canonical JSON header and blobs.

The header is `{"artifact": <type>, "fields": {...}}`: `identity.py` describes the names of types, `fields.py` the
encoding of values. The store and the engine can thus follow references without knowledge of any type.
"""

from __future__ import annotations

import io
import json
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, ClassVar, Generic, Self, TypeVar

from pydantic import BaseModel, ConfigDict, PrivateAttr, ValidationError, model_validator

from dextera_build import digest
from dextera_build.artifacts.core import above, fields, trees
from dextera_build.artifacts.core.arrays import Array as Array
from dextera_build.artifacts.core.content import SMALL, Content, Get, OnDisk, Put, Stored
from dextera_build.artifacts.core.forms import NOTHING, form_of, forms
from dextera_build.artifacts.core.identity import check, spelled, unreadable
from dextera_build.artifacts.core.labels import check_labels, check_paths
from dextera_build.artifacts.core.lazy import Lazy, contents
from dextera_build.artifacts.core.value import Value as Value
from dextera_build.errors import ArtifactError


class Artifact(BaseModel):
    """A typed, immutable value. Subclasses declare fields; arrays carry an `Array` annotation.

    Raises:
        ArtifactError: A field has a wrong type, shape or dtype, disagrees with another field, or is not finite.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", arbitrary_types_allowed=True)

    type_version: ClassVar[int] = 1
    """Incremented when the fields change, together with a reader of the previous version."""
    readers: ClassVar[Mapping[int, Callable[[dict[str, Any]], dict[str, Any]]]] = {}
    """Version -> function that converts the fields of a value of that version to those of the next."""
    former_fields: ClassVar[Mapping[str, Any]] = {}
    """Field that exists only in former versions -> its artifact type then."""
    saves: ClassVar[tuple[str, ...]] = ()
    """Suffixes of the files that `_write` writes, the preferred one first; types of dxb have modules in `formats`."""

    def __init__(self, **fields: Any) -> None:
        try:
            super().__init__(**fields)
        except ValidationError as error:
            raise ArtifactError(_explain(type(self).name(), error), code="DXB-A101") from None

    @classmethod
    def name(cls) -> str:
        """The type's name in messages, without parameters of a generic. Headers contain its `identity`."""
        return cls.__name__.split("[")[0]

    @classmethod
    def __pydantic_init_subclass__(cls, **_: Any) -> None:
        if cls.__pydantic_complete__:  # otherwise the first value is refused
            forms(cls)

    @model_validator(mode="after")
    def _check_arrays(self) -> Self:
        axes: dict[str, tuple[str, int]] = {}
        for name, form in forms(type(self)).items():
            if form.holds_arrays:
                fields.check(f"{self.name()}.{name}", name, getattr(self, name), form, axes)
        return self

    def facts(self) -> Iterator[str]:
        """The main facts about this value as text: counts, sizes, extents, units."""
        found: Iterator[str] = above.facts().facts(self)
        return found

    def picture(self) -> bytes | None:
        """PNG bytes of this value or of the first of its parts that has a picture, for notebooks."""
        found: bytes | None = above.previews(f"{self.name()}.picture").picture(self)
        return found

    def __repr__(self) -> str:
        found: str = above.facts().line(self)
        return found

    def _repr_html_(self) -> str:
        found: str = above.previews(f"{self.name()}._repr_html_").html(self)
        return found

    def encode(self, put: Put) -> str:
        """Store this value through `put(bytes) -> digest` and return the digest of its header."""
        stored = {name: fields.encode(getattr(self, name), form, put) for name, form in forms(type(self)).items()}
        return put(digest.canonical({"artifact": spelled(type(self)), "fields": stored}))

    @classmethod
    def decode(cls, key: str, get: Get) -> Self:
        """Load the value whose header has digest `key` through `get(digest) -> bytes`.

        Raises:
            ArtifactError: The header has another type, or its content is not valid.
        """
        return cls._from_header(json.loads(get(key)), get)

    @classmethod
    def _from_header(cls, header: Mapping[str, Any], get: Get) -> Self:
        version, known = check(cls, header["artifact"]), forms(cls)
        readers = [cls.readers.get(former) for former in range(version, cls.type_version)]
        if None in readers:
            raise unreadable(cls, version)
        if readers:
            known = {**known, **{name: form_of(hint, name) for name, hint in cls.former_fields.items()}}
        values = {name: fields.decode(raw, known.get(name, NOTHING), get) for name, raw in header["fields"].items()}
        for reader in filter(None, readers):
            values = reader(values)
        made = cls.__new__(cls)
        # A subclass's own checks are for new values; they do not apply to stored ones, such as files of a project.
        Artifact.__init__(made, **values)
        return made

    @classmethod
    def restore(cls, key: str, get: Get, folder: Path, stem: str) -> list[Path]:
        """Write the value whose header has digest `key` to `folder`, as `export` does.

        Types that can be written without being loaded into memory override it.
        """
        return cls.decode(key, get).export(folder, stem)

    def save(self, path: str | Path) -> list[Path]:
        """Write this value as the file `path`, in the format of its suffix, and return all files, `path` first.

        Raises:
            ArtifactError: The type has no such format.
            RuleError: A rule is being called; it imports a module of `formats`.
        """
        files: list[Path] = above.formats(f"{self.name()}.save").save(self, Path(path))
        return files

    @classmethod
    def load(cls, path: str | Path, **options: Any) -> Self:
        """Read a file of another program in the format of its suffix.

        Args:
            path: The file.
            options: Of the type's reader, `load` of its module in `formats`.

        Raises:
            ArtifactError: It is no such file, or the type has no such format.
            RuleError: A rule is being called; it imports a module of `formats`.
        """
        found: Self = above.formats(f"{cls.name()}.load").load(cls, Path(path), **options)
        return found

    def _write(self, path: Path) -> list[Path]:
        """Write `path`, whose suffix is one of `saves`, in any case of letters; for types outside of dxb."""
        raise NotImplementedError

    def export(self, folder: str | Path, stem: str) -> list[Path]:
        """Write this value to `folder` in common file formats, and return the files, the main one first.

        A type without a file format writes every field that is an artifact into its own files, and the rest as JSON
        and NPZ.
        """
        files: list[Path] = above.formats(f"{self.name()}.export").export(self, Path(folder), stem)
        return files


T = TypeVar("T", bound=Artifact)


class Collection(Artifact, Generic[T]):
    """Labelled artifacts of one type; the input of `each`, and the output of a group of nodes."""

    items: dict[str, T]
    """Label -> artifact. The label is not part of the item, so renaming an item does not change its digest."""

    def __init__(self, **fields: Any) -> None:
        super().__init__(**fields)
        check_labels(self.name(), self.items)

    @classmethod
    def _from_header(cls, header: Mapping[str, Any], get: Get) -> Self:
        """The value; from a store, each item is loaded at its first use."""
        if not hasattr(get, "place"):
            return super()._from_header(header, get)
        check(cls, header["artifact"])
        form = forms(cls)["items"].labelled or NOTHING
        stored = header["fields"]["items"]["$map"]
        items: Any = Lazy(stored, lambda raw: fields.decode_item(raw, form, get), keep=True)
        return cls.model_construct(items=items)  # type: ignore[return-value]  # of this very class


_FILE = re.compile(
    rb'\{"artifact":"File","fields":\{"data":\{"\$bytes":\["([0-9a-f]{64})",(0|[1-9][0-9]{0,17})\]\}\}\}'
)
"""The encoded header of a `File`, the type that nodes read most often."""


class File(Artifact):
    """The bytes of one file; its name is not part of it.

    Large content is read when `data` is first used; `path`, `open` and `place` never hold it in memory.
    """

    data: bytes
    """Content."""

    _content: Content | None = PrivateAttr(None)

    @classmethod
    def of(cls, path: str | Path) -> Self:
        """The content of a file that must no longer change; it is read when the value is stored."""
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

    @property
    def size(self) -> int:
        """Size of the content [bytes]; content outside memory is not read for it."""
        return len(self.data) if self._content is None else self._content.length()

    def __hash__(self) -> int:
        """Hash of the bytes."""
        return hash(self.data)

    def path(self, scratch: str | Path) -> Path:
        """A read-only file with this content; content in memory is written to `scratch`."""
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
        return put(digest.canonical({"artifact": spelled(type(self)), "fields": {"data": {"$bytes": [blob, size]}}}))

    @classmethod
    def decode(cls, key: str, get: Get) -> Self:
        """Load the value; large content stays in the store until its first use."""
        stored = get(key)
        known = _FILE.fullmatch(stored) if cls is File else None
        if known is not None and int(known[2]) <= SMALL:
            return cls._holding(get(known[1].decode()))
        header = json.loads(stored)
        if hasattr(get, "place") and header["artifact"] == spelled(cls) and list(header["fields"]) == ["data"]:
            blob, size = header["fields"]["data"]["$bytes"]
            if size > SMALL:
                return cls._behind(Stored(get, blob, size))
        return cls._from_header(header, get)

    @classmethod
    def _holding(cls, data: bytes) -> Self:
        """The value with this content without validation, which would take longer than the read."""
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

    @classmethod
    def of(cls, folder: str | Path) -> Self:
        """All files below a folder that must no longer change; each is read when it is used or stored."""
        paths = sorted(path for path in Path(folder).rglob("*") if path.is_file())
        found = {path.relative_to(folder).as_posix(): OnDisk(path) for path in paths}
        check_paths(cls.name(), found)
        return cls.model_construct(files=contents(found))  # type: ignore[return-value]  # of this very class

    def encode(self, put: Put) -> str:
        """Store this value; files that are not in memory are stored in pieces."""
        if type(self) is not Folder or not isinstance(self.files, Lazy):
            return super().encode(put)
        stored = {name: {"$bytes": list(self.files.source(name).store(put))} for name in self.files}
        return put(digest.canonical({"artifact": spelled(Folder), "fields": {"files": {"$map": stored}}}))

    @classmethod
    def _from_header(cls, header: Mapping[str, Any], get: Get) -> Self:
        """The value; from a store, each file is read when it is used."""
        if cls is not Folder or not hasattr(get, "place"):
            return super()._from_header(header, get)
        check(cls, header["artifact"])
        stored = header["fields"]["files"]["$map"]
        found = {name: Stored(get, *raw["$bytes"]) for name, raw in stored.items()}
        return cls.model_construct(files=contents(found))  # type: ignore[return-value]  # of this very class

    def export(self, folder: str | Path, stem: str) -> list[Path]:
        """Write the tree below `folder`; the first path is the topmost file, first by name."""
        return trees.write(self.files, Path(folder))

    @classmethod
    def restore(cls, key: str, get: Get, folder: Path, stem: str) -> list[Path]:
        """Write the tree from the store, file by file and in parallel, without holding it in memory."""
        copy = getattr(get, "place", None)
        if copy is None:
            return super().restore(key, get, folder, stem)
        tree = json.loads(get(key))["fields"]["files"]["$map"]
        return trees.restore({name: raw["$bytes"][0] for name, raw in tree.items()}, copy, folder)


def _explain(kind: str, error: ValidationError) -> str:
    first = error.errors(include_url=False)[0]
    place = ".".join(str(part) for part in first["loc"])
    return f"{kind}.{place}: {first['msg']}"

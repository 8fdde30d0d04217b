"""OCI image layouts: a folder, or the same in one tar archive. Bytes are checked as they are read."""

from __future__ import annotations

import hashlib
import os
from abc import ABC, abstractmethod
from collections.abc import Iterator
from pathlib import Path

from dextera_build.bundle import documents, oci, tar
from dextera_build.bundle.errors import MAGIC, archive, damaged, lacking, not_a_bundle, too_large
from dextera_build.bundle.oci import Descriptor
from dextera_build.store import files
from dextera_build.store.blobs import is_digest

VERSION = b'{"imageLayoutVersion":"1.0.0"}'
BLOBS = "blobs/sha256/"
_MOST_FILES = 3 * oci.MOST_LAYERS
_CHUNK = 1 << 20


class Layout(ABC):
    """A layout that is read.

    Args:
        path: Where it lies.
    """

    def __init__(self, path: Path) -> None:
        self.name = str(path)
        """As the command line names it."""

    def manifest(self) -> Descriptor:
        """The one manifest that its index names.

        Raises:
            BundleRefused: It is no layout, or names none or several.
        """
        index = self._document("index.json")
        version = documents.parse(self._document("oci-layout"), "`oci-layout`").get("imageLayoutVersion")
        if version != "1.0.0":
            raise not_a_bundle(self.name, "`oci-layout` names another version than 1.0.0")
        found = oci.read_index(index)
        if len(found) != 1 or found[0].media_type != oci.MANIFEST:
            hint = f"skopeo copy oci:{self.name}:TAG oci-archive:NAME.tar"
            raise not_a_bundle(self.name, f"its index names {len(found)} things, not one manifest", hint)
        return found[0]

    def stream(self, wanted: Descriptor, what: str = "a layer") -> Iterator[bytes]:
        """The bytes of a part, in pieces; size and digest are checked after the last one.

        Raises:
            BundleRefused: It is missing, cannot be read, or has other bytes than the descriptor says.
        """
        state, size = hashlib.sha256(), 0
        try:
            for piece in self._pieces(BLOBS + wanted.digest):
                size += len(piece)
                if size > wanted.size:
                    raise damaged(what, wanted.digest, f"has more than its {wanted.size} bytes")
                state.update(piece)
                yield piece
        except FileNotFoundError:
            raise lacking(f"a part of type `{wanted.media_type}`", wanted.digest) from None
        if size != wanted.size:
            raise damaged(what, wanted.digest, f"has {size} of its {wanted.size} bytes")
        if state.hexdigest() != wanted.digest:
            raise damaged(what, wanted.digest, "has other bytes")

    def whole(self, wanted: Descriptor, what: str, most: int) -> bytes:
        """All bytes of a small document.

        Raises:
            BundleRefused: It is larger than `most` bytes, or not what the descriptor names.
        """
        if wanted.size > most:
            raise too_large(what, wanted.size, most)
        return b"".join(self.stream(wanted, what))

    def _document(self, name: str) -> bytes:
        held, size = [], 0
        try:
            for chunk in self._pieces(name):
                held.append(chunk)
                size += len(chunk)
                if size > oci.MOST_MANIFEST:
                    raise too_large(f"`{name}`", size, oci.MOST_MANIFEST)
        except FileNotFoundError:
            raise not_a_bundle(self.name, f"it has no `{name}`") from None
        return b"".join(held)

    @abstractmethod
    def _pieces(self, name: str) -> Iterator[bytes]:
        """The bytes of a file, or `FileNotFoundError`."""


class Folder(Layout):
    """A layout in a folder."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._root = os.path.abspath(path)

    def _pieces(self, name: str) -> Iterator[bytes]:
        # Links could lead out of the folder, and a pipe would block.
        descriptor = -1
        try:
            descriptor = os.open(f"{self._root}/{name}", os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
            if os.path.realpath(f"{self._root}/{name}") != os.path.join(os.path.realpath(self._root), name):
                raise archive(name, "lies behind a link")
            yield from files.chunks(descriptor)
        except FileNotFoundError:
            raise
        except OSError as error:
            raise archive(name, f"cannot be read ({error.strerror})") from None
        finally:
            if descriptor >= 0:
                os.close(descriptor)


class Archive(Layout):
    """A layout in a tar archive.

    Raises:
        BundleRefused: It is none, or holds what no layout holds.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._path = path
        self._places: dict[str, tuple[int, int]] = {}
        with path.open("rb") as file:
            start = file.read(8)
        for magic, kind in MAGIC.items():
            if start.startswith(magic):
                raise not_a_bundle(self.name, f"it is compressed ({kind})", "unpack it first; bundles are plain tar")
        for found, place, size in tar.places(path, _MOST_FILES):
            name = found.removeprefix("./")
            if name not in ("oci-layout", "index.json") and not (
                name.startswith(BLOBS) and is_digest(name.removeprefix(BLOBS))
            ):
                raise archive(found[:200], "is no part of an OCI image layout")
            if name in self._places:
                raise archive(name, "stands twice")
            self._places[name] = (place, size)

    def _pieces(self, name: str) -> Iterator[bytes]:
        if name not in self._places:
            raise FileNotFoundError
        place, size = self._places[name]
        with self._path.open("rb") as file:
            file.seek(place)
            while size:
                chunk = file.read(min(size, _CHUNK))
                if not chunk:
                    raise archive(name, "is cut off")
                size -= len(chunk)
                yield chunk


def read(path: Path) -> Layout:
    """The layout at a path.

    Raises:
        BundleRefused: There is none.
    """
    try:
        return Folder(path) if path.is_dir() else Archive(path)
    except OSError as error:
        raise not_a_bundle(str(path), f"it cannot be read ({error.strerror})") from None

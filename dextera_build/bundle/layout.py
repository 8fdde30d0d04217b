"""OCI image layouts in tar archives. Bytes are checked as they are read."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path

from dextera_build.bundle import documents, oci, tar
from dextera_build.bundle.errors import MAGIC, archive, damaged, lacking, not_a_bundle, too_large
from dextera_build.bundle.oci import Descriptor
from dextera_build.store.blobs import is_digest

VERSION = b'{"imageLayoutVersion":"1.0.0"}'
BLOBS = "blobs/sha256/"
_MOST_FILES = 3 * oci.MOST_LAYERS
_CHUNK = 1 << 20


class Layout:
    """A layout that is read.

    Args:
        path: Where it lies.

    Raises:
        BundleRefused: It is none, or holds what no layout holds.
    """

    def __init__(self, path: Path) -> None:
        self.name = str(path)
        """As the command line names it."""
        self._path = path
        self._places: dict[str, tuple[int, int]] = {}
        try:
            with path.open("rb") as file:
                start = file.read(8)
        except OSError as error:
            hint = f"skopeo copy oci:{path} oci-archive:NAME.tar" if path.is_dir() else None
            raise not_a_bundle(self.name, f"it cannot be read ({error.strerror})", hint) from None
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
            raise not_a_bundle(self.name, f"its index names {len(found)} things, not one manifest")
        return found[0]

    def stream(self, wanted: Descriptor, what: str = "a layer") -> Iterator[bytes]:
        """The bytes of a part, in pieces; the size is checked before the first one, the digest after the last.

        Raises:
            BundleRefused: It is missing, cannot be read, or has other bytes than the descriptor says.
        """
        name, state = BLOBS + wanted.digest, hashlib.sha256()
        if name not in self._places:
            raise lacking(f"a part of type `{wanted.media_type}`", wanted.digest)
        size = self._places[name][1]
        if size != wanted.size:
            raise damaged(what, wanted.digest, f"has {size} bytes, not {wanted.size}")
        for piece in self._pieces(name):
            state.update(piece)
            yield piece
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
        if name not in self._places:
            raise not_a_bundle(self.name, f"it has no `{name}`")
        size = self._places[name][1]
        if size > oci.MOST_MANIFEST:
            raise too_large(f"`{name}`", size, oci.MOST_MANIFEST)
        return b"".join(self._pieces(name))

    def _pieces(self, name: str) -> Iterator[bytes]:
        place, size = self._places[name]
        with self._path.open("rb") as file:
            file.seek(place)
            while size:
                chunk = file.read(min(size, _CHUNK))
                if not chunk:
                    raise archive(name, "is cut off")
                size -= len(chunk)
                yield chunk

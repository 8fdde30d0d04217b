"""OCI image layouts in tar archives, read by the `tarfile` of the standard library.

A header of anything but a file or a folder (a link, a device, a long name, an extended header) is refused before
`tarfile` acts on it. Every part is verified against its digest before it is read.
"""

from __future__ import annotations

import hashlib
import tarfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Self

from dextera_build.bundle import documents, oci
from dextera_build.bundle.errors import archive, damaged, lacking, not_a_bundle, too_large
from dextera_build.bundle.oci import Descriptor
from dextera_build.store.blobs import is_digest

BLOBS = "blobs/sha256/"
MOST_FILES = 1 << 14
"""Most files in one archive; `tarfile` keeps a record of each in memory."""
_VERSION = documents.Form("1.0.0", lambda it: it == "1.0.0")
_KINDS = (tarfile.REGTYPE, tarfile.AREGTYPE, tarfile.DIRTYPE)


class _File(tarfile.TarInfo):
    """The header of a file or a folder."""

    @classmethod
    def fromtarfile(cls, packed: tarfile.TarFile) -> Self:
        # Looked at before the base class acts on it, which from Python 3.13 on does not call `frombuf`.
        assert packed.fileobj is not None
        start = packed.fileobj.tell()
        header = packed.fileobj.read(tarfile.BLOCKSIZE)
        packed.fileobj.seek(start)
        with suppress(tarfile.HeaderError):
            found = tarfile.TarInfo.frombuf(header, packed.encoding or "utf-8", packed.errors or "strict")
            if found.type not in _KINDS:
                raise archive(found.name, "is neither a file nor a folder")
            if found.size < 0:
                raise archive(found.name, "has a negative size")
        return super().fromtarfile(packed)


@contextmanager
def reading(name: str, file: IO[bytes]) -> Iterator[tarfile.TarFile]:
    """Open an archive for the block.

    Raises:
        BundleRefused: It is not an archive, or is damaged, even if `tarfile` detects that within the block.
    """
    packed = None
    try:
        with tarfile.open(fileobj=file, mode="r:", tarinfo=_File, errors="strict") as packed:
            yield packed
    except (tarfile.TarError, ValueError, OverflowError, OSError) as error:
        raise (
            archive(name, f"cannot be read ({error})") if packed else not_a_bundle(name, "it is not a tar archive")
        ) from None


def files(packed: tarfile.TarFile) -> Iterator[tarfile.TarInfo]:
    """The files of an archive; folders are skipped.

    Raises:
        BundleRefused: It holds too many files, or two with the same name.
    """
    seen = set()
    for number, info in enumerate(packed):
        if number >= MOST_FILES:
            raise too_large("an archive", number + 1, MOST_FILES)
        if info.name in seen:
            raise archive(info.name, "occurs twice")
        seen.add(info.name)
        if not info.isdir():
            yield info


class Layout:
    """An image layout in a tar archive.

    Args:
        path: The archive.

    Raises:
        BundleRefused: It is not a layout, or holds files that no layout has.
    """

    def __init__(self, path: Path) -> None:
        self.name = str(path)
        """As given on the command line."""
        self._path = path
        with self._archive() as packed:
            self._parts = {info.name.removeprefix("./"): info for info in files(packed)}
        for name in self._parts.keys() - {"oci-layout", "index.json"}:
            if not name.startswith(BLOBS) or not is_digest(name.removeprefix(BLOBS)):
                raise archive(name, "is not part of an OCI image layout")

    def manifest(self) -> Descriptor:
        """The one manifest that its index names.

        Raises:
            BundleRefused: It is not a layout, or does not name exactly one manifest.
        """
        index, version = self._document("index.json"), self._document("oci-layout")
        documents.parse(version, {"imageLayoutVersion": _VERSION}, "`oci-layout`")
        found = oci.read_index(index)
        if len(found) != 1 or found[0].media_type != oci.MANIFEST:
            raise not_a_bundle(self.name, f"its index names {len(found)} things, not one manifest")
        return found[0]

    @contextmanager
    def part(self, wanted: Descriptor, what: str = "a layer") -> Iterator[IO[bytes]]:
        """Open a part of the layout, after verifying its size and digest.

        Raises:
            BundleRefused: It is missing, cannot be read, or does not match its descriptor.
        """
        info = self._parts.get(BLOBS + wanted.digest)
        if info is None:
            raise lacking(f"a part of type `{wanted.media_type}`", wanted.digest)
        if info.size != wanted.size:
            raise damaged(what, wanted.digest, f"has {info.size} bytes, not {wanted.size}")
        with self._archive() as packed, packed.extractfile(info) as file:  # type: ignore[union-attr]
            if hashlib.file_digest(file, "sha256").hexdigest() != wanted.digest:  # type: ignore[arg-type]
                raise damaged(what, wanted.digest, "has other bytes")
            file.seek(0)
            yield file

    def whole(self, wanted: Descriptor, what: str, most: int) -> bytes:
        """All bytes of a small document.

        Raises:
            BundleRefused: It is larger than `most` bytes, or does not match its descriptor.
        """
        if wanted.size > most:
            raise too_large(what, wanted.size, most)
        with self.part(wanted, what) as file:
            return file.read()

    def _document(self, name: str) -> bytes:
        info = self._parts.get(name)
        if info is None:
            raise not_a_bundle(self.name, f"it has no `{name}`")
        if info.size > oci.MOST_MANIFEST:
            raise too_large(f"`{name}`", info.size, oci.MOST_MANIFEST)
        with self._archive() as packed, packed.extractfile(info) as file:  # type: ignore[union-attr]
            return file.read()

    @contextmanager
    def _archive(self) -> Iterator[tarfile.TarFile]:
        try:
            file = self._path.open("rb")
        except OSError as error:
            hint = f"skopeo copy oci:{self._path} oci-archive:NAME.tar" if self._path.is_dir() else None
            raise not_a_bundle(self.name, f"it cannot be read ({error.strerror})", hint) from None
        with file, reading(self.name, file) as packed:
            yield packed

"""One artifact as one file, for programs that run without a store: header and blobs by digest, checked when read."""

from __future__ import annotations

import io
import zipfile
import zlib
from typing import TypeVar

from dextera_build import digest
from dextera_build.artifacts.base import Artifact
from dextera_build.errors import ArtifactError

A = TypeVar("A", bound=Artifact)

ROOT = "artifact"
"""Member with the digest of the header; every other member is a blob named by its digest."""
DAY = (1980, 1, 1, 0, 0, 0)
"""Date of every member, so that equal artifacts give equal bytes."""
_MOST = 1 << 30
"""Maximum size of an unpacked artifact [bytes], because a small untrusted file could otherwise fill the memory."""
_UNREADABLE = (
    zipfile.BadZipFile,
    KeyError,
    ValueError,  # also for offsets beyond the file
    NotImplementedError,
    RuntimeError,
    EOFError,
    zlib.error,
)


def pack(artifact: Artifact) -> bytes:
    """A zip file of the artifact; equal artifacts give equal bytes."""
    blobs: dict[str, bytes] = {}

    def put(data: bytes) -> str:
        key = digest.of_bytes(data)
        blobs[key] = data
        return key

    root = artifact.encode(put)
    written = io.BytesIO()
    with zipfile.ZipFile(written, "w") as archive:
        for name, data in [(ROOT, root.encode()), *sorted(blobs.items())]:
            archive.writestr(zipfile.ZipInfo(name, DAY), data, zipfile.ZIP_DEFLATED, 6)
    return written.getvalue()


def unpack(kind: type[A], data: bytes, name: str = "this") -> A:
    """The artifact in a file written by `pack`; errors call the file `name`.

    Raises:
        ArtifactError: The file is damaged, has another type, or unpacks to more than 1 GiB.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            _forbid_bombs(archive)
            root = archive.read(ROOT).decode("ascii")
            return kind.decode(root, lambda key: _blob(archive, key))
    except _UNREADABLE as error:
        raise ArtifactError(f"{name} is not a packed {kind.name()}", code="DXB-A109", facts={"why": error}) from None


def _forbid_bombs(archive: zipfile.ZipFile) -> None:
    if any(member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) for member in archive.infolist()):
        raise zipfile.BadZipFile("a member is compressed by another method than deflate")
    # A member is never read beyond its declared size.
    size = sum(member.file_size for member in archive.infolist())
    if size > _MOST:
        facts = {"bytes": f"{size:,}", "most": f"{_MOST:,}"}
        raise ArtifactError("a packed artifact is too large", code="DXB-A112", facts=facts)


def _blob(archive: zipfile.ZipFile, key: str) -> bytes:
    found = archive.read(key)
    if digest.of_bytes(found) != key:
        raise ArtifactError("a packed artifact is damaged", code="DXB-A110", facts={"blob": key[:12]})
    return found

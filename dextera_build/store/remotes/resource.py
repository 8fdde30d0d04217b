"""Names of blobs in byte streams: `[instance/]blobs/{hash}/{size}`, `[instance/]uploads/{uuid}/blobs/{hash}/{size}`."""

from __future__ import annotations

import re
import uuid

from dextera_build.store.remotes.remote import Digest

_READ = re.compile(r"(?:.*/)?blobs/([0-9a-f]{64})/([0-9]{1,18})")
# Whoever uploads may add parts after the size; they mean nothing.
_WRITE = re.compile(r"(?:.*/)?uploads/[^/]+/blobs/([0-9a-f]{64})/([0-9]{1,18})(?:/.*)?")


def to_read(instance: str, digest: Digest) -> str:
    """The name under which a blob is read."""
    return "/".join([*_first(instance), "blobs", digest.hash, str(digest.size)])


def to_write(instance: str, digest: Digest) -> str:
    """A new name under which a blob is uploaded."""
    return "/".join([*_first(instance), "uploads", str(uuid.uuid4()), "blobs", digest.hash, str(digest.size)])


def read_from(name: str) -> Digest:
    """The blob that a client asks for.

    Raises:
        ValueError: That is not the name of a blob by SHA-256, uncompressed.
    """
    return _digest(_READ.fullmatch(name), name)


def written_to(name: str) -> Digest:
    """The blob that a client uploads.

    Raises:
        ValueError: That is not the name of an upload by SHA-256, uncompressed.
    """
    return _digest(_WRITE.fullmatch(name), name)


def _first(instance: str) -> list[str]:
    return [instance] if instance else []


def _digest(found: re.Match[str] | None, name: str) -> Digest:
    if found is None:
        raise ValueError(f"`{name[:200]}` names no blob by SHA-256")
    return Digest(found[1], int(found[2]))

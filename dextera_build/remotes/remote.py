"""The interface of a remote: results by key and blobs by digest, shared by several machines.

A remote is not trusted: bytes from it are checked against their digest. A remote that misbehaves makes a build slower,
never wrong, and never makes it fail.
"""

from __future__ import annotations

import ipaddress
from collections.abc import Callable, Collection, Iterator
from contextlib import suppress
from io import BytesIO
from typing import BinaryIO, Literal, NamedTuple, TypeAlias, TypeVar
from urllib.parse import urlsplit

from dextera_build.redact import redact

T = TypeVar("T")
Kind: TypeAlias = Literal["ac", "cas"]
"""Entries or blobs."""
MOST_ENTRY = 64 << 20
"""Longest accepted entry [bytes]; each blob takes about 150 bytes of an entry."""


def is_loopback(host: str) -> bool:
    """Whether a host is a loopback name or address, which only this machine reaches."""
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def is_named(host: str, names: Collection[str]) -> bool:
    """Whether a `Host` header is an address or one of `names`.

    A web page of another site reaches a server of this machine by a name of its own that was made to point here (DNS
    rebinding); the header then holds that name.
    """
    try:
        name = urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return False
    with suppress(ValueError):
        ipaddress.ip_address(name)
        return True
    return name in names


class Digest(NamedTuple):
    """Digest and size of a blob."""

    hash: str
    """Lower-case hex SHA-256."""
    size: int
    """[bytes]"""


class RemoteFault(Exception):  # noqa: N818 - says what happened, as `MissingBlob` does
    """A remote failed: no connection, a timeout, a malformed answer.

    Args:
        address: The remote.
        reason: The fault, for users; both are shown without secrets.
        refused: The remote works and rejected the request (no permission, no such method): a retry does not help.
    """

    def __init__(self, address: str, reason: str, *, refused: bool = False) -> None:
        self.address, self.reason = redact(address), redact(reason)
        super().__init__(f"{self.address}: {self.reason}")
        self.refused = refused


class Remote:
    """Two maps, entries and blobs. Every method may be called from several threads and raises only `RemoteFault`.

    A subclass implements `has`, `_get` and `_put`.
    """

    address: str
    """As given on the command line, without secrets."""

    def get_entry(self, key: str) -> bytes | None:
        """The entry under a key (the digest of the key document), or None; `entry.py` describes its format.

        An entry longer than `MOST_ENTRY` raises `RemoteFault` before all of it is in memory.
        """
        return self._get("ac", key, self._short)

    def put_entry(self, key: str, message: bytes) -> None:
        """Publish a result whose blobs are all in the remote."""
        self._put("ac", Digest(key, len(message)), BytesIO(message))

    def has(self, digest: Digest) -> bool:
        """Whether the remote holds a blob, with this size."""
        raise NotImplementedError

    def fetch(self, digest: Digest, take: Callable[[Iterator[bytes]], bool]) -> bool | None:
        """Hand `take` the bytes of a blob in pieces, and return its result; None if the remote lacks the blob.

        `take` checks size and bytes, and may stop before the last piece. Its errors pass through.
        """
        return self._get("cas", digest.hash, take)

    def send(self, digest: Digest, file: BinaryIO) -> None:
        """Upload a blob, from the current position of the file."""
        self._put("cas", digest, file)

    def close(self) -> None:
        """Close connections; pending calls raise `RemoteFault`."""

    def _short(self, pieces: Iterator[bytes]) -> bytes:
        found = bytearray()
        for piece in pieces:
            found += piece
            if len(found) > MOST_ENTRY:
                raise RemoteFault(self.address, "an entry does not end")
        return bytes(found)

    def _get(self, kind: Kind, name: str, take: Callable[[Iterator[bytes]], T]) -> T | None:
        """Pass an entry or a blob to `take` and return its result; None if the remote lacks it."""
        raise NotImplementedError

    def _put(self, kind: Kind, digest: Digest, file: BinaryIO) -> None:
        """Upload an entry or a blob of this name and size."""
        raise NotImplementedError

"""The interface of a remote: results by key and blobs by digest, shared by several machines.

A remote is not trusted: bytes from it are checked against their digest. A remote that misbehaves makes a build slower,
never wrong, and never makes it fail.
"""

from __future__ import annotations

import ipaddress
from collections.abc import Callable, Iterator
from io import BytesIO
from typing import BinaryIO, Literal, NamedTuple, TypeAlias, TypeVar

from dextera_build.redact import redact

T = TypeVar("T")
Kind: TypeAlias = Literal["ac", "cas"]
"""Entries or blobs."""
MOST_ENTRY = 64 << 20
"""A result under a key that is longer is not taken [bytes]; one blob takes about 150 bytes there."""


def is_loopback(host: str) -> bool:
    """Whether only this machine can be reached, or can reach us, at a host."""
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


class Digest(NamedTuple):
    """Names bytes."""

    hash: str
    """Lower-case hex SHA-256."""
    size: int
    """How many bytes."""


class RemoteFault(Exception):  # noqa: N818 - says what happened, as `MissingBlob` does
    """A remote did not do what it was asked: no connection, a time-out, an answer that makes no sense.

    Args:
        address: The remote.
        reason: What happened, for people; both are shown without secrets.
        refused: The remote works and said no (no right to, no such method): to ask again does not help.
    """

    def __init__(self, address: str, reason: str, *, refused: bool = False) -> None:
        self.address, self.reason = redact(address), redact(reason)
        super().__init__(f"{self.address}: {self.reason}")
        self.refused = refused


class Remote:
    """Two maps. Every method may be called from several threads, and raises `RemoteFault` and nothing else.

    A subclass implements `has`, `_get` and `_put`.
    """

    address: str
    """As the command line names it, without secrets."""

    def get_entry(self, key: str) -> bytes | None:
        """The entry under a key (the digest of the key document), or None; `entry.py` says how it is spelled.

        One that is longer than `MOST_ENTRY` is a `RemoteFault`, found before all of it is in memory.
        """
        return self._get("ac", key, self._short)

    def put_entry(self, key: str, message: bytes) -> None:
        """Publish a result, all of whose blobs the remote holds."""
        self._put("ac", Digest(key, len(message)), BytesIO(message))

    def has(self, digest: Digest) -> bool:
        """Whether the remote holds a blob, with this size."""
        raise NotImplementedError

    def fetch(self, digest: Digest, take: Callable[[Iterator[bytes]], bool]) -> bool | None:
        """Hand `take` the bytes of a blob in pieces, and return what it returns; None if the remote lacks the blob.

        `take` checks size and bytes, and may stop before the last piece. Its errors pass through.
        """
        return self._get("cas", digest.hash, take)

    def send(self, digest: Digest, file: BinaryIO) -> None:
        """Upload a blob, from the place where the file stands."""
        self._put("cas", digest, file)

    def close(self) -> None:
        """Let connections go; calls that wait for an answer end with a `RemoteFault`."""

    def _short(self, pieces: Iterator[bytes]) -> bytes:
        found = bytearray()
        for piece in pieces:
            found += piece
            if len(found) > MOST_ENTRY:
                raise RemoteFault(self.address, "an entry does not end")
        return bytes(found)

    def _get(self, kind: Kind, name: str, take: Callable[[Iterator[bytes]], T]) -> T | None:
        """What `take` makes of an entry or a blob; None if the remote lacks it."""
        raise NotImplementedError

    def _put(self, kind: Kind, digest: Digest, file: BinaryIO) -> None:
        """Upload an entry or a blob of this name and size."""
        raise NotImplementedError

"""Results that clients of the cache server bring and take: dxb's own, and those of other tools."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from dextera_build.errors import StoreError
from dextera_build.store import files
from dextera_build.store.cas import MissingBlob, is_digest
from dextera_build.store.reapi import fields
from dextera_build.store.remotes import entry as entries
from dextera_build.store.remotes.remote import Digest
from dextera_build.store.store import Store

_FOREIGN = {2: 2, 3: 3, 6: 0, 8: 0}
"""Field of `ActionResult` that names a blob -> field of its value that holds the digest; 0: the value is the digest."""


class Offers:
    """Results by key; only such whose blobs are all there.

    Args:
        store: Holds dxb's own results, and all blobs.
    """

    def __init__(self, store: Store) -> None:
        self._store = store
        self._foreign = store.root / "foreign"

    def get(self, key: str) -> bytes | None:
        """The `ActionResult` message of a key, or None."""
        if self._store.actions.get(key) is not None:
            own = self._store.actions.message(key)
            return own[0] if own else None
        try:
            message = files.read(str(self._file(key)))
        except OSError:
            return None
        return message if _lacking(self._store, message) is None else None

    def put(self, key: str, message: bytes) -> str:
        """Take a result; returns why not, or "".

        Raises:
            StoreError: The disk is full, or the store cannot be written.
        """
        try:
            lacking = _lacking(self._store, message)
        except ValueError:
            return "this is not an ActionResult message"
        if lacking is not None:
            return f"blob {lacking} is not here; blobs come first"
        entry = entries.read(message, Digest(key, self._store.blobs.size(key) or 0))
        if entry is None:
            files.write(str(self._file(key)), message)
            return ""
        if self._store.actions.get(key) is not None:
            return ""
        try:
            document = entry.inline or self._store.blobs.get(entry.document.hash)
            result = entries.result(entry, document)
            if result is None:
                return "the result does not fit its entry"
            self._store.actions.put(key, result)
        except MissingBlob as error:
            return f"blob {error.digest} is not here; blobs come first"
        except StoreError:
            raise
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            return "a header is damaged"
        return ""

    def _file(self, key: str) -> Path:
        return self._foreign / key[:2] / key[2:]


def _lacking(store: Store, message: bytes) -> str | None:
    """The first blob that an `ActionResult` names and the store lacks, or None.

    Raises:
        ValueError: It is not such a message.
    """
    for digest in named(message):
        if digest.size and store.blobs.size(digest.hash) != digest.size:
            return digest.hash
    return None


def named(message: bytes) -> Iterator[Digest]:
    """The blobs that an `ActionResult` message of any tool names: files, trees, what was printed.

    Raises:
        ValueError: It is not such a message.
    """
    try:
        for number, value in fields(message):
            if number in _FOREIGN and isinstance(value, bytes):
                inner = _FOREIGN[number]
                body = dict(fields(value)).get(inner) if inner else value
                # An output that stands in the message itself need not be named.
                if isinstance(body, bytes):
                    yield _digest(body)
    except IndexError:
        raise ValueError("the message ends too early") from None


def _digest(body: bytes) -> Digest:
    parts = dict(fields(body))
    name, size = parts.get(1, b""), parts.get(2, 0)
    if not isinstance(name, bytes) or not isinstance(size, int) or not is_digest(name.decode("ascii", "replace")):
        raise ValueError("not a SHA-256 digest")
    return Digest(name.decode(), size)

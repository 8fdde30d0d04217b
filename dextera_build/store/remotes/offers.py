"""Results that clients of the cache server bring and take."""

from __future__ import annotations

from contextlib import suppress

from dextera_build.errors import StoreError
from dextera_build.store.cas import MissingBlob
from dextera_build.store.remotes import entry as entries
from dextera_build.store.remotes.remote import Digest
from dextera_build.store.store import Store
from dextera_build.store.traces.tree import publish


class Offers:
    """Results by key; only such whose blobs are all there.

    Args:
        store: Holds them.
    """

    def __init__(self, store: Store) -> None:
        self._store = store

    def get(self, key: str) -> bytes | None:
        """The entry of a key, or None; each blob that it names is there."""
        own = self._store.actions.message(key) if self._store.actions.get(key) is not None else None
        if own is None:
            return None
        with suppress(StoreError):  # a store that may only be read serves what it holds
            for file in own[1]:
                if file.contents and not self._store.blobs.has(file.digest):
                    self._store.blobs.put(file.contents)
        return own[0]

    def put(self, key: str, message: bytes) -> str:
        """Take a result; returns why not, or "".

        Raises:
            StoreError: The disk is full, or the store cannot be written.
        """
        entry = entries.read(message, Digest(key, self._store.blobs.size(key) or 0))
        if entry is None:
            return "this is no result of dxb, or its key document is not here; blobs come first"
        lacking = next((blob for blob in entry.blobs if self._store.blobs.size(blob.hash) != blob.size), None)
        if lacking is not None:
            return f"blob {lacking.hash} is not here; blobs come first"
        if self._store.actions.get(key) is not None:
            return ""
        try:
            document = entry.inline or self._store.blobs.get(entry.document.hash)
            result = entries.result(entry, document)
            if result is None:
                return "the result does not fit its entry"
            publish(self._store, key, result)
        except MissingBlob as error:
            return f"blob {error.digest} is not here; blobs come first"
        except StoreError:
            raise
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            return "a header is damaged"
        return ""

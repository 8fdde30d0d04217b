"""Results as the cache server gives and takes them."""

from __future__ import annotations

from dextera_build.errors import StoreError
from dextera_build.store import entry as entries
from dextera_build.store import traces
from dextera_build.store.blobs import MissingBlob
from dextera_build.store.store import Store


class Offers:
    """Results by key, if all their blobs are there.

    Args:
        store: Holds them.
    """

    def __init__(self, store: Store) -> None:
        self._store = store

    def get(self, key: str) -> bytes | None:
        """The entry of a key, or None."""
        is_whole = self._store.actions.get(key) is not None
        entry = self._store.actions.entry(key) if is_whole else None
        return entry.spell() if entry is not None else None

    def put(self, key: str, message: bytes) -> str:
        """Take a result; returns why not, or "".

        Raises:
            StoreError: The disk is full, or the store cannot be written.
        """
        try:
            entry = entries.read(message)
        except ValueError:
            return "this is no result of dxb"
        if entry.key != key or entry.is_bare:
            return "the result of another key, or a bare one"
        lacking = next((file for file in entry.files if self._store.blobs.size(file.digest) != file.size), None)
        if lacking is not None:
            return f"blob {lacking.digest} is not here; blobs come first"
        try:
            if self._store.actions.get(key) is None or traces.listed(self._store, entry.result):
                traces.publish(self._store, key, entry.result, entry.document)
        except MissingBlob as error:
            return f"blob {error.digest} is not here; blobs come first"
        except StoreError:
            raise
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            return "a header is damaged"
        return ""

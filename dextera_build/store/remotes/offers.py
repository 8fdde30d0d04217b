"""Results that clients of the cache server bring and take: dxb's own, and those of other tools."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from dextera_build.errors import StoreError
from dextera_build.store import files, wire
from dextera_build.store.cas import MissingBlob, is_digest
from dextera_build.store.remotes import entry as entries
from dextera_build.store.remotes import execution
from dextera_build.store.remotes.remote import MOST_ENTRY, Digest
from dextera_build.store.store import Store
from dextera_build.store.traces.tree import publish


class Offers:
    """Results by key; only such whose blobs are all there.

    Args:
        store: Holds dxb's own results, and all blobs.
    """

    def __init__(self, store: Store) -> None:
        self._store = store

    def get(self, key: str) -> bytes | None:
        """The `ActionResult` message of a key, or None."""
        if self._store.actions.get(key) is not None:
            return self._own(key)
        try:
            message, stamp = files.read_stamped(str(self._file(key)))
        except OSError:
            return None
        try:
            if _lacking(self._store, message) is not None:
                return None
        except ValueError:
            return None
        with suppress(PermissionError):  # what another user brought is of use for as long as that one says
            self._store.blobs.use.note(str(self._file(key)), stamp)
        return message

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
            publish(self._store, key, result)
        except MissingBlob as error:
            return f"blob {error.digest} is not here; blobs come first"
        except StoreError:
            raise
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            return "a header is damaged"
        return ""

    def _own(self, key: str) -> bytes | None:
        """A result of dxb, with a blob for each file that it names: whoever asks may look for all of them."""
        own = self._store.actions.message(key)
        if own is None:
            return None
        with suppress(StoreError):  # a store that may only be read serves what it holds
            for file in own[1]:
                if file.contents and not self._store.blobs.has(file.digest):
                    self._store.blobs.put(file.contents)
        return own[0]

    def _file(self, key: str) -> Path:
        return self._store.foreign / key[:2] / key[2:]


def _lacking(store: Store, message: bytes) -> str | None:
    """The first blob that an `ActionResult` names and the store lacks, or None.

    Raises:
        ValueError: It is not such a message.
    """
    for digest in named(store, message):
        if not is_digest(digest.hash):
            raise ValueError("a result names what is not a SHA-256 digest")
        if digest.size and store.blobs.size(digest.hash) != digest.size:
            return digest.hash
    return None


def named(store: Store, message: bytes) -> Iterator[Digest]:
    """The blobs that an `ActionResult` message of any tool names: files, folders with all below them, what was printed.

    Raises:
        ValueError: It is not such a message.
    """
    result = wire.decode(execution.ActionResult, message)
    for file in result.output_files:
        yield file.digest
    for digest in (result.stdout_digest, result.stderr_digest):
        if digest != execution.NO_DIGEST:
            yield digest
    for folder in result.output_directories:
        yield folder.tree_digest
        yield from _in_tree(store, folder.tree_digest)


def _in_tree(store: Store, digest: Digest) -> Iterator[Digest]:
    if not is_digest(digest.hash) or not 0 <= digest.size <= MOST_ENTRY:
        raise ValueError("a result names a tree that cannot be read")
    try:
        tree = wire.decode(execution.Tree, store.blobs.get(digest.hash) if digest.size else b"")
    except MissingBlob:
        return  # said already: the tree is named before what lies in it
    for directory in (tree.root, *tree.children):
        for file in directory.files:
            yield file.digest

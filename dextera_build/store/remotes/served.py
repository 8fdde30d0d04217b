"""Results that clients bring and ask for: `ActionResult` messages of any tool, kept as they came."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator

from dextera_build.store import files, wire
from dextera_build.store.cas import MissingBlob, is_digest
from dextera_build.store.remotes import execution
from dextera_build.store.remotes.remote import MOST_ENTRY, Digest
from dextera_build.store.store import Store

EMPTY = Digest(hashlib.sha256().hexdigest(), 0)
"""The blob that is always there."""


def read(store: Store, key: str) -> bytes | None:
    """The message under a key, or None where there is none or a blob that it names is not there."""
    try:
        message = files.read(_path(store, key))
        return message if lacking(store, message) is None else None
    except (OSError, ValueError):
        return None


def write(store: Store, key: str, message: bytes) -> None:
    """Keep a message under a key.

    Raises:
        StoreError: The disk is full, or the store cannot be written.
    """
    files.write(_path(store, key), message, workshop=f"{store.actions.root}/{files.TEMPORARY}")


def lacking(store: Store, message: bytes) -> Digest | None:
    """A blob that a result names and the store has not, or None where all of them are there.

    Raises:
        ValueError: That is not a result.
    """
    for digest in _named(store, wire.decode(execution.ActionResult, message)):
        if not is_digest(digest.hash):
            raise ValueError("a result names what is not a SHA-256 digest")
        if store.blobs.size(digest.hash) != digest.size and digest != EMPTY:
            return digest
    return None


def _named(store: Store, result: execution.ActionResult) -> Iterator[Digest]:
    for file in result.output_files:
        yield file.digest
    for digest, raw in ((result.stdout_digest, result.stdout_raw), (result.stderr_digest, result.stderr_raw)):
        if digest != execution.NO_DIGEST and not raw:
            yield digest
    for folder in result.output_directories:
        yield folder.tree_digest
        yield from _in_tree(store, folder.tree_digest)


def _in_tree(store: Store, digest: Digest) -> Iterator[Digest]:
    if not is_digest(digest.hash) or digest.size > MOST_ENTRY:
        raise ValueError("a result names a tree that cannot be read")
    try:
        tree = wire.decode(execution.Tree, store.blobs.get(digest.hash) if digest.size else b"")
    except MissingBlob:
        yield digest
        return
    for directory in (tree.root, *tree.children):
        for file in directory.files:
            yield file.digest


def _path(store: Store, key: str) -> str:
    return f"{store.actions.root}/{key[:2]}/{key[2:]}"

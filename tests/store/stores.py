"""Stores of small artifacts, built by hand."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from dextera_build import digest
from dextera_build.gc.collect import Collection
from dextera_build.store.entry import ActionResult
from dextera_build.store.store import Store

DAY = 86400.0
"""[s]."""


def key_of(name: str) -> str:
    """A key: the digest of its document."""
    return digest.of_bytes(document(name))


def document(name: str) -> bytes:
    return f"key of {name}".encode()


def publish(store: Store, name: str, blobs: Iterable[bytes] = ()) -> str:
    """Store a result that holds `blobs`, and return its key."""
    fields = {f"b{n}": {"$bytes": [store.blobs.put(data), len(data)]} for n, data in enumerate(blobs)}
    output = store.blobs.put(digest.canonical({"artifact": "Bag", "fields": {"name": name, **fields}}))
    result = ActionResult(output, "", (), {}, 1.0, None, store.blobs.put(document(name)))
    store.actions.put(key_of(name), result)
    return key_of(name)


def entry(store: Store, key: str) -> Path:
    """The file of a result."""
    return store.actions.root / key[:2] / key[2:]


def forged(
    message: bytes,
    files: Callable[[list[Any]], list[Any]] = lambda files: files,
    result: Callable[[bytes], bytes] = lambda made: made,
) -> bytes:
    """A modified entry with correct digests."""
    head, made = message.split(b"\n", 1)
    raw, made = json.loads(head), result(made)
    raw |= {"files": files(raw["files"]), "result": digest.of_bytes(made)}
    return json.dumps(raw).encode() + b"\n" + made


def age(path: Path, used: float) -> None:
    """Set the last use of a file."""
    os.utime(path, (used, used))


def age_all(store: Store, used: float) -> None:
    """Set the last use of every file in the store."""
    for folder in (store.blobs.root, store.actions.root, store.local):
        for path in folder.rglob("*"):
            if path.is_file():
                age(path, used)


def harm(path: Path, data: bytes) -> None:
    """Overwrite a read-only file."""
    path.chmod(0o644)
    path.write_bytes(data)


def nobody() -> dict[str, set[str]]:
    return {}


def held(*keys: str) -> Callable[[], dict[str, set[str]]]:
    return lambda: {"someone": set(keys)}


def keys(store: Store) -> set[str]:
    return set(store.actions.keys())


def contents(store: Store) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in store.root.rglob("*") if path.is_file() and path.name != "locks"}


def rows(said: Collection) -> dict[str, int]:
    return {row.kind: row.count for row in said.gone}


def assert_whole(store: Store) -> None:
    """Check that every result has all of its blobs, and nothing is damaged."""
    for key in keys(store):
        found = store.actions.get(key)
        assert found is not None
        for name in {found.output, found.key_document, *store.actions.references.below(found.output)}:
            store.blobs.get(name)

"""Putting blobs where people and programs open them."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

from dextera_build.store import failpoints, files
from dextera_build.store.blobs import Blobs, MissingBlob


def place(blobs: Blobs, digest: str, target: Path) -> None:
    """Write the blob to `target`, writable and its own: blocks are shared where the file system can, else copied.

    Raises:
        MissingBlob: The blob is not there, or is damaged.
        StoreError: The target's disk is full, or cannot be written.
    """
    try:
        source = os.open(blobs.path(digest), os.O_RDONLY | os.O_CLOEXEC)
    except OSError as error:
        raise MissingBlob(digest, str(error.strerror).lower()) from None
    try:
        with files.new_file(str(target), 0o644) as descriptor:
            _copy(blobs, digest, source, descriptor)
            failpoints.reach("place.copied")
    finally:
        os.close(source)


def _copy(blobs: Blobs, digest: str, source: int, target: int) -> None:
    state = hashlib.sha256()
    cloned = files.clone(source, target)
    for chunk in files.chunks(target if cloned else source):
        state.update(chunk)
        if not cloned:
            files.write_all(target, chunk)
    if state.hexdigest() != digest:
        blobs.quarantine(digest)
        raise MissingBlob(digest, "damaged bytes, moved to quarantine")

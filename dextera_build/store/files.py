"""Atomic file writes, and errors that explain why a write failed.

Files are not flushed one by one: a power cut may leave one truncated, which its digest reveals, and its content is
built again. `settle` flushes everything that a build wrote with one call.
"""

from __future__ import annotations

import errno
import fcntl
import os
import re
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from typing import Any

from dextera_build.errors import StoreError
from dextera_build.store import disk_full, failpoints, permissions, signature

_FICLONE = 0x40049409
_CHUNK = 1 << 20
_NEW = os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
TEMPORARY = ".tmp"
"""Name prefix of unfinished files, and of folders for them."""
_UNFINISHED = re.compile(rf"{re.escape(TEMPORARY)}-[0-9a-f]{{16}}")


def store_error(error: OSError, path: str) -> StoreError:
    """The error to show for a failed write to the store."""
    if error.errno in disk_full.FULL:
        return StoreError(
            "the store is full",
            code="DXB-S101",
            facts={
                "file": path,
                "system says": error.strerror,
                "free": f"{disk_full.free_bytes(path) / 2**20:,.0f} MiB",
            },
            hint="`dxb cache size` shows its size; free space, or set `DXB_CACHE` to a larger disk and build again",
        )
    no_folder = error.errno in (errno.EEXIST, errno.ENOTDIR)
    return StoreError(
        "a file is in the place of a folder of the store" if no_folder else "the store cannot be written",
        code="DXB-S102",
        facts={"file": path, "system says": error.strerror},
        hint="set `DXB_CACHE` to a folder that you may write to",
    )


@contextmanager
def new_file(path: str, mode: int = 0o444, workshop: str | None = None) -> Iterator[int]:
    """Yield a descriptor to write to; the file atomically replaces `path` when the block ends.

    Args:
        path: The file.
        mode: Its permissions.
        workshop: Folder on the same file system for the unfinished file; None: the folder of `path`. ext4 creates a
            file ten times faster in a recently used folder (23 us) than in one of 256 (224 us). With a workshop, a
            folder at `path` counts as damage of the store and is moved aside.

    Raises:
        StoreError: The disk is full, or the folder cannot be written.
    """
    folder = workshop or os.path.dirname(path)
    temporary = f"{folder}/{TEMPORARY}-{unique()}"
    descriptor = -1
    try:
        descriptor = _create(folder, temporary, mode)
        failpoints.reach("file.made")
        yield descriptor
        failpoints.reach("file.written")
        os.close(descriptor)
        descriptor = -1
        _move(temporary, path, is_ours=workshop is not None)
        failpoints.reach("file.moved")
    except BaseException as error:
        _give_up(error, path, temporary, descriptor)
        raise


def unique() -> str:
    """A name that is unique across calls, processes and machines."""
    return os.urandom(8).hex()


def write(path: str, data: bytes | memoryview, mode: int = 0o444, workshop: str | None = None) -> None:
    """Write `data` to `path` atomically; see `new_file`.

    Raises:
        StoreError: The disk is full, or the folder cannot be written.
    """
    with new_file(path, mode, workshop) as descriptor:
        write_all(descriptor, data)


def clear(folder: str, age_s: float = 60.0) -> None:
    """Remove unfinished files older than `age_s` [s] of killed processes from a folder without garbage collection."""
    with suppress(OSError):
        for entry in os.scandir(folder):
            if _UNFINISHED.fullmatch(entry.name) and entry.stat().st_mtime < time.time() - age_s:
                os.unlink(entry.path)


def remove(path: str) -> None:
    """Remove a file, a link, or a folder with its contents; the target of a link is not touched.

    Raises:
        OSError: It cannot be removed.
    """
    if os.path.isdir(path) and not os.path.islink(path):
        shutil.rmtree(path)  # follows no link either
    else:
        os.unlink(path)


def write_all(descriptor: int, data: bytes | bytearray | memoryview) -> None:
    """Write all of `data`, in as many system calls as that takes."""
    done = os.write(descriptor, data)
    while done < len(data):
        done += os.write(descriptor, data[done : done + _CHUNK])


def read(path: str) -> bytes:
    """All bytes of a file."""
    return read_stamped(path)[0]


def read_stamped(path: str) -> tuple[bytes, float]:
    """All bytes of a file, and its modification time (seconds since the epoch)."""
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        state = os.fstat(descriptor)
        data = os.read(descriptor, state.st_size + 1)
        if len(data) != state.st_size:  # the file is changing, or the read was partial
            data += b"".join(chunks(descriptor))
        return data, state.st_mtime
    finally:
        os.close(descriptor)


def clone(source: int, target: int) -> bool:
    """Share the blocks of `source` with `target` if the file system can (btrfs, xfs, bcachefs)."""
    try:
        fcntl.ioctl(target, _FICLONE, source)
    except OSError:
        return False
    return True


def chunks(descriptor: int) -> Iterator[bytes]:
    """The bytes of an open file from its current position, in pieces."""
    # Each read allocates a buffer, and one of full size costs more than reading a small file.
    piece = min(_CHUNK, os.fstat(descriptor).st_size + 1)
    while chunk := os.read(descriptor, piece):
        yield chunk


def _create(folder: str, temporary: str, mode: int) -> int:
    try:
        descriptor = os.open(temporary, _NEW, mode)
    except FileNotFoundError:
        permissions.make_folder(folder)
        descriptor = os.open(temporary, _NEW, mode)
    permissions.share_file(descriptor, folder, mode)
    return descriptor


def _give_up(error: BaseException, path: str, temporary: str, descriptor: int) -> None:
    """Remove an unfinished file; raise a `StoreError` if `error` came from the system."""
    # Built before the unfinished file is removed, to report the free space at the time of the error.
    said = store_error(error, path) if isinstance(error, OSError) else None
    if descriptor >= 0:
        os.close(descriptor)
    with suppress(OSError):
        os.unlink(temporary)
    if said is not None:
        raise said from None


def _move(temporary: str, path: str, *, is_ours: bool) -> None:
    try:
        os.replace(temporary, path)
    except FileNotFoundError:
        permissions.make_folder(os.path.dirname(path))
        os.replace(temporary, path)
    except IsADirectoryError:
        if not is_ours:
            raise
        # Damage: moved aside under the name of an unfinished file, which garbage collection removes.
        os.rename(path, f"{os.path.dirname(path)}/{TEMPORARY}-{unique()}")
        os.replace(temporary, path)


def settle(folder: str) -> bool:
    """Flush the file system of `folder` to disk; return whether the system confirms it."""
    call = _syncfs()
    if call is None:
        os.sync()
        return True
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            return bool(call(descriptor) == 0)
        finally:
            os.close(descriptor)
    return False


def file_system(path: str) -> str:
    """Type of the file system of a path, as the system calls it: `nfs4`; "" if unknown."""
    with suppress(OSError, ValueError, IndexError):
        device = os.stat(path).st_dev
        return next((kind for mounted, kind, _, _ in signature.mounts() if mounted == device), "")
    return ""


@cache
def _syncfs() -> Any:
    """`syncfs` of the C library, or None if it has none; unlike `sync`, it leaves other disks alone."""
    import ctypes  # slow to import

    try:
        return ctypes.CDLL(None, use_errno=True).syncfs
    except (OSError, AttributeError):
        return None

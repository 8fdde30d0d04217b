"""Content-addressed blobs: digest -> bytes, one read-only file each under `ab/cdef...`."""

from __future__ import annotations

import hashlib
import os
import re
import stat
from collections.abc import Callable, Iterable, Iterator
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import BinaryIO

from dextera_build.errors import StoreError
from dextera_build.store import failpoints, files, permissions
from dextera_build.store.last_use import Use
from dextera_build.store.locks import Locks

_DIGEST = re.compile(r"[0-9a-f]{64}", re.ASCII)
_DAMAGED = "damaged bytes, moved to quarantine"
_SMALL = 1 << 20
"""Files up to this size [bytes] are read once, in full; larger ones are read twice, in pieces."""


class MissingBlob(StoreError):  # noqa: N818 - says what it found
    """A referenced blob is not in the store, or was damaged and moved to quarantine."""

    CODE = "DXB-S103"

    def __init__(self, digest: str, reason: str = "it is not there") -> None:
        super().__init__(
            f"blob `{digest[:12]}` cannot be read: {reason}",
            code="DXB-S103",
            facts={"digest": digest},
            hint="build again: its producer runs again",
        )
        self.digest = digest


class Blobs:
    """Blobs below one folder.

    Writers never replace a good file and readers verify what they read, so any number of processes may share it.

    Args:
        root: The folder; created with the first blob.
        takes: False for a read-only store: `put` keeps bytes in memory, and `put_file` only digests the file.
    """

    def __init__(self, root: Path, *, takes: bool = True) -> None:
        self.root = root
        self._unwritten: dict[str, bytes] | None = None if takes else {}
        self._base = f"{root}/"
        self._workshop = f"{root}/{files.TEMPORARY}"
        self._quarantine = root.parent / "local" / "quarantine"
        self.use = Use(Locks(root.parent / "local" / "locks"))

    def path(self, digest: str) -> Path:
        """Path of the blob's file, which need not exist."""
        return Path(self._file(digest))

    def has(self, digest: str) -> bool:
        """Whether the blob exists; its bytes are not read."""
        return self.size(digest) is not None

    def size(self, digest: str) -> int | None:
        """Size of the blob [bytes], or None if it does not exist."""
        try:
            state = os.stat(self._file(digest))
            if stat.S_ISREG(state.st_mode):
                return state.st_size
        except OSError:
            pass
        return len(self._unwritten[digest]) if self._unwritten and digest in self._unwritten else None

    def put(self, data: bytes | memoryview) -> str:
        """Store `data` and return its digest.

        Raises:
            StoreError: The disk is full, or the store cannot be written.
        """
        digest = hashlib.sha256(data).hexdigest()
        if self._unwritten is not None:
            self._unwritten[digest] = bytes(data)
            return digest
        path = self._file(digest)
        # A power cut can leave a truncated file, which is replaced.
        if not self.holds(digest, len(data), lambda: files.read(path) == data):
            files.write(path, data, workshop=self._workshop)
        return digest

    def holds(self, digest: str, size: int, check: Callable[[], bool] | None = None) -> bool:
        """Whether the blob exists with this size; if so, it is protected from collection while this build runs.

        Args:
            digest: Digest of the blob.
            size: Its size [bytes].
            check: Verifies its bytes; called if the blob was not used recently.
        """
        path = self._file(digest)
        try:
            state = os.stat(path)
            if state.st_size != size or not stat.S_ISREG(state.st_mode):
                return False
            if check is not None and not self.use.is_recent(state.st_mtime) and not check():
                return False
            return self.use.note(path, state.st_mtime)
        except PermissionError:
            # Another user owns the file; only a new copy of our own gets a new time stamp.
            return self._copied(digest)
        except OSError:
            return False

    def put_file(self, path: Path) -> tuple[str, int]:
        """Store the bytes of a file, sharing its blocks if the file system can, and return (digest, size).

        Raises:
            OSError: `path` cannot be read.
            StoreError: The disk is full, or the store cannot be written.
        """
        with open(path, "rb", buffering=0) as file:
            size = os.fstat(file.fileno()).st_size
            if size <= _SMALL and self._unwritten is None and len(data := file.read(size + 1) or b"") == size:
                return self.put(data), size
            file.seek(0)
            return self._take(file.fileno())

    def receive(self, digest: str, size: int | None, pieces: Iterable[bytes]) -> bool:
        """Store untrusted bytes; return False if they do not match `digest` and `size`.

        If `size` is known, at most `size` bytes are accepted. The blob appears only after its digest was verified. An
        existing blob is not written again.

        Raises:
            StoreError: The disk is full, or the store cannot be written.
        """
        known, left = hashlib.sha256(), size
        is_here = size is not None and self.size(digest) == size
        new = nullcontext(-1) if is_here else files.new_file(self._file(digest), workshop=self._workshop)
        try:
            with new as target:
                for piece in pieces:
                    if left is not None and (left := left - len(piece)) < 0:
                        break
                    known.update(piece)
                    if not is_here:
                        files.write_all(target, piece)
                if left or known.hexdigest() != digest:
                    raise _ChangedError(digest)
        except _ChangedError:
            return False
        return True

    def get(self, digest: str) -> bytes:
        """The bytes of a blob, checked against its digest.

        Raises:
            MissingBlob: It does not exist, or is damaged and was moved to quarantine.
        """
        if self._unwritten and digest in self._unwritten:
            return self._unwritten[digest]
        try:
            data = files.read(self._file(digest))
        except OSError as error:
            raise _absent(digest, error) from None
        if hashlib.sha256(data).hexdigest() != digest:
            self.quarantine(digest)
            raise MissingBlob(digest, _DAMAGED)
        return data

    def place(self, digest: str, target: Path) -> None:
        """Write a writable copy of the blob to `target`, sharing its blocks if the file system can.

        Raises:
            MissingBlob: The blob does not exist or is damaged.
            StoreError: The target's disk is full, or cannot be written.
        """
        with self.open(digest) as source, files.new_file(str(target), 0o644) as descriptor:
            if _copy(source.fileno(), descriptor) != digest:
                self.quarantine(digest)
                raise MissingBlob(digest, _DAMAGED)
            failpoints.reach("place.copied")

    def open(self, digest: str) -> BinaryIO:
        """Open the blob's file without verifying it.

        Raises:
            MissingBlob: It does not exist.
        """
        try:
            return open(self._file(digest), "rb")
        except OSError as error:
            raise _absent(digest, error) from None

    def checked(self, digest: str) -> BinaryIO:
        """Open the blob's file after verifying its digest.

        Raises:
            MissingBlob: It does not exist, or is damaged and was moved to quarantine.
        """
        file = self.open(digest)
        try:
            if hashlib.file_digest(file, "sha256").hexdigest() == digest:  # type: ignore[arg-type]
                file.seek(0)
                return file
        except OSError as error:
            file.close()
            raise _absent(digest, error) from None
        file.close()
        self.quarantine(digest)
        raise MissingBlob(digest, _DAMAGED)

    def verify(self, digest: str) -> bool:
        """Whether the blob exists and is intact; a damaged one is moved to quarantine."""
        try:
            self.checked(digest).close()
        except MissingBlob:
            return False
        return True

    def quarantine(self, digest: str) -> None:
        """Move a damaged blob to quarantine; it then counts as missing."""
        # A read-only store keeps it; readers verify the bytes anyway.
        with suppress(OSError):
            permissions.make_folder(str(self._quarantine))
            failpoints.reach("blob.aside")
            os.replace(self._file(digest), self._quarantine / digest)

    def all(self) -> Iterator[tuple[str, int]]:
        """Every blob with its size [bytes]."""
        yield from ((digest, size) for digest, size, _ in listing(self.root))

    def _file(self, digest: str) -> str:
        if not is_digest(digest):
            raise StoreError(f"`{digest}` is not a SHA-256 digest", code="DXB-S104")
        return f"{self._base}{digest[:2]}/{digest[2:]}"

    def _copied(self, digest: str) -> bool:
        try:
            with self.open(digest) as source:
                return self.receive(digest, None, files.chunks(source.fileno()))
        except (OSError, StoreError):
            return False

    def _take(self, source: int) -> tuple[str, int]:
        digest, size = _digest(source), os.lseek(source, 0, os.SEEK_CUR)
        if self._unwritten is None and not self.holds(digest, size, lambda: self.verify(digest)):
            os.lseek(source, 0, os.SEEK_SET)
            with files.new_file(self._file(digest), workshop=self._workshop) as target:
                if _copy(source, target) != digest:
                    raise _ChangedError(digest)
        return digest, size


def _copy(source: int, target: int) -> str:
    """Copy one open file to another, sharing blocks if the file system can; return the digest of the copy."""
    if files.clone(source, target):
        return _digest(target)
    state = hashlib.sha256()
    for chunk in files.chunks(source):
        state.update(chunk)
        files.write_all(target, chunk)
    return state.hexdigest()


def _digest(descriptor: int) -> str:
    state = hashlib.sha256()
    for chunk in files.chunks(descriptor):
        state.update(chunk)
    return state.hexdigest()


def _absent(digest: str, error: OSError) -> MissingBlob:
    return MissingBlob(digest, "it is not there" if isinstance(error, FileNotFoundError) else str(error.strerror))


def is_digest(text: str) -> bool:
    """Whether `text` has the form of a digest: 64 lower-case hex digits."""
    return _DIGEST.fullmatch(text) is not None


class _ChangedError(StoreError):
    """A file changed between two reads; callers that read files retry."""

    def __init__(self, digest: str) -> None:
        super().__init__("a file changed while it was read", code="DXB-S105", facts={"digest": digest})


def listing(root: Path) -> Iterator[tuple[str, int, float]]:
    """Every file `ab/cdef...` below `root` whose name is a digest: (digest, bytes, last use)."""
    for shard in shards(root):
        yield from listed(shard)


def shards(root: Path) -> list[str]:
    """The folders `ab` below `root`."""
    return [entry.path for entry in _scan(str(root)) if len(entry.name) == 2 and entry.is_dir(follow_symlinks=False)]


def listed(shard: str) -> Iterator[tuple[str, int, float]]:
    """The part of a `listing` in one folder."""
    for entry in _scan(shard):
        digest = shard[-2:] + entry.name
        if is_digest(digest):
            with suppress(FileNotFoundError):
                state = entry.stat(follow_symlinks=False)
                yield digest, state.st_size, state.st_mtime


def _scan(folder: str) -> list[os.DirEntry[str]]:
    try:
        return sorted(os.scandir(folder), key=lambda entry: entry.name)
    except (FileNotFoundError, NotADirectoryError):
        return []

"""Verification of a store: blobs against their names, and results against the blobs that they name."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from dextera_build import digest as digests
from dextera_build.errors import StoreError
from dextera_build.gc import inventory
from dextera_build.store import failpoints, files, last_use
from dextera_build.store.blobs import listed, shards
from dextera_build.store.store import Store

Progress = Callable[[int, int], None]
"""Takes the number of blobs read so far, and their bytes."""


@dataclass(frozen=True, order=True)
class Finding:
    """One problem in the store."""

    kind: str
    """`damaged`, `truncated`: a blob; `unreadable`, `lacking`: a result; `leftover`: an unfinished file of a killed
    process, which is not damage."""
    name: str
    """Digest, key or path."""
    detail: str
    repaired: bool = False


@dataclass
class Verdict:
    """The outcome of a verification."""

    blobs: int = 0
    bytes: int = 0
    results: int = 0
    findings: list[Finding] = field(default_factory=list)

    @property
    def is_whole(self) -> bool:
        """Whether there is no damage, or all of it was repaired."""
        return all(finding.repaired or finding.kind == "leftover" for finding in self.findings)


def verify(
    store: Store, *, fast: bool = False, repair: bool = False, jobs: int = 0, progress: Progress | None = None
) -> Verdict:
    """Check every blob and every result.

    Args:
        store: The store; builds may run meanwhile.
        fast: Compare sizes only, and read no blob.
        repair: Move damaged blobs to quarantine, remove invalid results and leftovers. A removed result is a miss, and
            is built again when it is needed.
        jobs: Number of blobs to read in parallel; 0: one per core.
        progress: Called at most ten times a second.

    Raises:
        StoreError: `repair` is set, and the store is read-only or a link lies in it.
    """
    if repair:
        inventory.refuse_links(store)
    if repair and (folder := inventory.unwritable(store)) is not None:
        raise StoreError(
            "the store is read-only and cannot be repaired",
            code="DXB-S402",
            facts={"folder": str(folder)},
            hint="ask its owner; `dxb cache verify` without `--repair` only reads",
        )
    verifier = _Verifier(store, fast, repair, progress or (lambda count, size: None))
    verifier.blobs(jobs or len(os.sched_getaffinity(0)))
    verifier.results()
    verifier.leftovers()
    verifier.verdict.findings.sort()
    return verifier.verdict


class _Verifier:
    def __init__(self, store: Store, fast: bool, repair: bool, progress: Progress) -> None:
        self._store = store
        self._fast = fast
        self._repair = repair
        self._progress = progress
        self._told = 0.0
        self._guard = threading.Lock()
        self._results = dict(inventory.results(store))
        sizes = (size for kept in self._results.values() for size in kept.needs.items())
        self._sizes = {digest: size for digest, size in sizes if size is not None}
        self.verdict = Verdict()

    def blobs(self, jobs: int) -> None:
        """Read every blob, several folders in parallel: hashing and reading release the GIL."""
        with ThreadPoolExecutor(jobs) as pool:
            for _ in pool.map(self._shard, shards(self._store.blobs.root)):
                pass

    def _shard(self, folder: str) -> None:
        for digest, size, _ in listed(folder):
            with self._guard:
                self.verdict.blobs += 1
                self.verdict.bytes += size
                self._tell()
            with suppress(FileNotFoundError):
                self._blob(digest, size)

    def _blob(self, digest: str, size: int) -> None:
        path = self._store.blobs.path(digest)
        wanted = self._sizes.get(digest, size)
        # A result may be wrong about a size; the digest decides.
        if (size != wanted or not self._fast) and not _is_named_right(digest, path):
            kind = "truncated" if size < wanted else "damaged"
            what = f"{size} of {wanted} bytes" if kind == "truncated" else "its bytes do not match its digest"
            self._find(kind, digest, what, str(path))

    def results(self) -> None:
        """Check every result against the blobs that are present now."""
        self.verdict.results = len(self._results)
        for key, kept in self._results.items():
            lacks = [name for name, size in kept.needs.items() if size not in (None, self._store.blobs.size(name))]
            path = inventory.path_of(self._store, key)
            if lacks:
                self._find("lacking", key, f"{len(lacks)} of {len(kept.needs)} blobs are not there", path)
            elif not kept.needs:
                self._find("unreadable", key, "it is not a result, or belongs to another key", path)

    def leftovers(self) -> None:
        """Find leftovers of killed processes; files that may still be in use are left alone."""
        horizon = min([time.time(), *self._store.running.starts()]) - last_use.STEP_S - last_use.SLACK_S
        aside = str(self._store.local / "quarantine")
        for path, size, used in inventory.leftovers(self._store):
            if used < horizon and os.path.dirname(path) != aside:
                self._find("leftover", path, f"{size} bytes", path)

    def _find(self, kind: str, name: str, detail: str, path: str) -> None:
        if self._repair:
            with suppress(OSError):
                failpoints.reach("repair.found")
                if kind in ("damaged", "truncated"):
                    self._store.blobs.quarantine(name)
                else:
                    files.remove(path)
        with self._guard:
            self.verdict.findings.append(Finding(kind, name, detail, self._repair and not os.path.lexists(path)))

    def _tell(self) -> None:
        if time.monotonic() - self._told >= 0.1:
            self._told = time.monotonic()
            self._progress(self.verdict.blobs, self.verdict.bytes)


def _is_named_right(digest: str, path: Path) -> bool:
    try:
        return digests.of_file(path) == digest
    except FileNotFoundError:
        raise
    except OSError:
        return False

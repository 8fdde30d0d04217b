"""Results between the store and a remote, whole or not at all.

What comes is checked: blobs against digest and size, entries against what they name, and the local entry is written
anew from the headers that arrived. What goes is checked, too, for many remotes check nothing themselves.
"""

from __future__ import annotations

import threading
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import BinaryIO

from dextera_build.errors import StoreError
from dextera_build.store import failpoints, header, space
from dextera_build.store.actions import ActionResult
from dextera_build.store.cas import MissingBlob
from dextera_build.store.remotes import entry as entries
from dextera_build.store.remotes.remote import DamagedBlob, Digest, Remote
from dextera_build.store.store import Store


@dataclass(frozen=True)
class Fetched:
    """A result that a remote had."""

    result: ActionResult
    octets: int
    """How many bytes had to come."""


@dataclass(frozen=True)
class Sent:
    """A result that a remote has now."""

    blobs: int
    octets: int


class Transfer:
    """Fetches and uploads results; may be used by several threads.

    Args:
        store: The local end.
    """

    def __init__(self, store: Store) -> None:
        self._store = store
        self._guard = threading.Lock()
        self._held: defaultdict[str, set[Digest]] = defaultdict(set)
        """Remote -> blobs that are known to be there."""
        self._damaged: defaultdict[str, set[Digest]] = defaultdict(set)
        """Remote -> blobs that it gave wrongly; sent again although it says that it has them."""

    def fetch(self, remote: Remote, key: Digest) -> Fetched | None:
        """Bring the result of `key` with all that it names; None where the remote lacks it or a part of it.

        Raises:
            RemoteFault: The remote did not answer rightly.
            StoreError: The local disk is full, or the store cannot be written.
        """
        message = remote.get_action(key)
        entry = entries.read(message, key) if message is not None else None
        if entry is None:
            return None
        wanted = [blob for blob in entry.blobs if self._store.blobs.size(blob.hash) != blob.size]
        if not entry.inline and self._store.blobs.size(entry.document.hash) != entry.document.size:
            wanted.append(entry.document)
        if sum(blob.size for blob in wanted) > space.free_bytes(str(self._store.root)):
            return None  # an entry may say any size; what cannot fit is not begun
        if not self.blobs(remote, wanted):
            return None
        try:
            document = entry.inline or self._store.blobs.get(entry.document.hash)
            result = entries.result(entry, document)
            if result is None or not all(entries.is_record(self._store.blobs.get(name)) for _, name in result.calls):
                return None
            failpoints.reach("fetch.blobs")
            self._store.actions.put(key.hash, result)
        except (MissingBlob, ValueError, KeyError, TypeError, AttributeError, RecursionError):
            # A header is not one, or names what the entry does not.
            return None
        except StoreError as error:
            if error.code != header.ESCAPES:
                raise
            return None
        return Fetched(result, sum(blob.size for blob in wanted))

    def blobs(self, remote: Remote, wanted: Iterable[Digest]) -> bool:
        """Bring blobs; False where the remote lacks one.

        Raises:
            RemoteFault: The remote did not answer rightly, or gave other bytes.
            StoreError: The local disk is full, or the store cannot be written.
        """
        came: set[Digest] = set()
        wrong: list[Digest] = []
        troubles: list[StoreError] = []

        def take(digest: Digest, pieces: Iterator[bytes]) -> None:
            try:
                if not troubles:
                    (came.add if self._store.blobs.receive(*digest, pieces) else wrong.append)(digest)
            except StoreError as error:
                troubles.append(error)

        asked = list(dict.fromkeys(wanted))
        if asked:
            remote.fetch(asked, take)
        if troubles:
            raise troubles[0]
        with self._guard:
            self._held[remote.address] |= came
            self._damaged[remote.address].update(wrong)
        if wrong:
            raise DamagedBlob(remote.address, f"blob `{wrong[0].hash[:12]}` came with other bytes")
        return came.issuperset(asked)

    def send(self, remote: Remote, key: str) -> Sent:
        """Upload the result of `key`: blobs first, the entry last and only if all of them arrived.

        Raises:
            RemoteFault: The remote did not take it.
            MissingBlob: The local store does not hold the result, or not all of it.
        """
        found = self._store.actions.message(key)
        if found is None:
            raise MissingBlob(key, "the store has no result under this key")
        message, named = found
        for file in named:
            if file.path.startswith("calls/"):  # first, so that whoever has another key for its node finds the answer
                self.send(remote, file.digest)
        blobs = list(dict.fromkeys(Digest(file.digest, file.size) for file in named))
        document = next(blob for blob, file in zip(blobs, named, strict=False) if file.path == "key.json")
        with self._guard:
            damaged = self._damaged[remote.address].intersection(blobs)
            asked = [blob for blob in blobs if blob not in self._held[remote.address] and blob not in damaged]
        wanted = [*damaged, *(remote.missing(asked) if asked else ())]
        if wanted:
            remote.send(sorted(wanted), self._open)
        with self._guard:
            self._held[remote.address].update(blobs)
            self._damaged[remote.address].difference_update(wanted)
        remote.put_action(document, message)
        return Sent(len(wanted), sum(blob.size for blob in wanted))

    def _open(self, digest: Digest) -> BinaryIO:
        if not self._store.blobs.verify(digest.hash):
            raise MissingBlob(digest.hash)
        try:
            return open(self._store.blobs.path(digest.hash), "rb")
        except OSError:
            raise MissingBlob(digest.hash) from None

"""Transfers results between the store and a remote, whole or not at all.

Downloads are checked: blobs against digest and size, entries against their key, and the local entry is rebuilt from the
headers that arrived. Uploads are checked, too, since many remotes check nothing themselves.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from typing import Any

from dextera_build import digest as digests
from dextera_build.errors import StoreError
from dextera_build.remotes.remote import MOST_ENTRY, Digest, Remote, RemoteFault
from dextera_build.remotes.threads import Crew
from dextera_build.store import disk_full, failpoints, headers, traces
from dextera_build.store import entry as entries
from dextera_build.store.blobs import MissingBlob
from dextera_build.store.entry import Entry, File
from dextera_build.store.references import UNREADABLE
from dextera_build.store.results import Found
from dextera_build.store.store import Store

_AT_ONCE = 16


class Transfer:
    """Fetches and uploads results; may be used by several threads.

    Args:
        store: The local store.
        crew: Threads that transfer the blobs of a result.
    """

    def __init__(self, store: Store, crew: Crew | None = None) -> None:
        self._store, self._crew = store, crew or Crew(_AT_ONCE, "dxb blobs")
        self._right: dict[tuple[str, Digest], bool] = {}
        """(remote, blob) -> True if the remote has it, False if it sent wrong bytes although it claims to have it."""

    def fetch(self, remote: Remote, key: str, *, whole: bool = True) -> Found | None:
        """Download the result of `key`; None if the remote lacks it or a part of it.

        Args:
            remote: Where from.
            key: Digest of the key document.
            whole: Download every blob that it names; otherwise only the key document and the headers of its output.

        Raises:
            RemoteFault: The remote failed or sent wrong bytes.
            StoreError: The local disk is full, or the store cannot be written.
        """
        entry = entry_at(remote, key)
        if entry is None:
            return None
        try:
            if not self._bring(remote, [file for file in entry.files if whole or file.role in entries.HEADERS]):
                return None
            failpoints.reach("fetch.blobs")
            is_whole = traces.publish(self._store, key, entry.result, may_lack=not whole)
        except UNREADABLE:
            # A header is malformed, or names a blob that the entry does not name.
            return None
        except StoreError as error:
            if error.code != headers.ESCAPES:
                raise
            return None
        return Found(entry.result, is_whole)

    def _bring(self, remote: Remote, files: Iterable[File]) -> bool:
        """Download the blobs that the store lacks; return False if the remote lacks one.

        Raises:
            RemoteFault: The remote failed or sent wrong bytes.
            StoreError: The local disk is full, or the store cannot be written.
        """
        wanted = [blob for blob in _blobs(files) if self._store.blobs.size(blob.hash) != blob.size]
        if sum(blob.size for blob in wanted) > disk_full.free_bytes(str(self._store.root)):
            return False  # an entry may claim any size; a download that cannot fit is not started
        lacking: list[Digest] = []

        def bring(blob: Digest) -> None:
            right = remote.fetch(blob, lambda pieces: self._store.blobs.receive(*blob, pieces))
            if right is None:
                lacking.append(blob)
                return
            self._right[remote.address, blob] = right
            if not right:
                raise RemoteFault(remote.address, f"blob `{blob.hash[:12]}` does not match its digest")

        self._crew.each(bring, wanted)
        return not lacking

    def send(self, remote: Remote, key: str) -> int:
        """Upload the result of `key`: blobs first, the entry last and only if all of them arrived.

        Returns the bytes of the blobs that the remote lacked.

        Raises:
            RemoteFault: The remote failed or rejected it.
            MissingBlob: The local store does not hold the result, or not all of it.
        """
        entry = self._store.actions.entry(key)
        if entry is None or entry.is_bare:
            raise MissingBlob(key, "the store has no whole result under this key")
        for call, _ in entry.result.calls:  # first, so that nodes with other keys find the answer, too
            self.send(remote, call)
        octets = self._deliver(remote, entry)
        parts = traces.parts_of(self._store.blobs.get(key))
        if parts is not None and parts[1] is not None:
            self._send_traces(remote, parts[0])
        return octets

    def holds(self, remote: Remote, key: str) -> bool:
        """Whether the remote has a result with all its bytes.

        Raises:
            RemoteFault: The remote failed.
        """
        entry = entry_at(remote, key)
        return entry is not None and all(map(remote.has, _blobs(entry.files)))

    def _send_traces(self, remote: Remote, static: Mapping[str, Any]) -> None:
        """Merge the traces of a call with discovered inputs into the remote's list."""
        key = digests.of_bytes(traces.spelled(static, None))
        there: list[traces.Steps] = []
        with suppress(RemoteFault):  # an upload works without them
            entry = entry_at(remote, key)
            is_short = entry is not None and (entry.files[0].size or 0) <= MOST_ENTRY
            if entry is not None and is_short and self._bring(remote, entry.files[:1]):
                there = traces.listed(self._store, entry.result)
        found = traces.merged(traces.known(self._store, key), there)
        if found != there:
            self._deliver(remote, self._store.actions.made(traces.made(self._store, static, found)))

    def _deliver(self, remote: Remote, entry: Entry) -> int:
        sent: list[int] = []

        def deliver(blob: Digest) -> None:
            right = self._right.get((remote.address, blob))
            if right is None:
                right = remote.has(blob)
            if not right:
                with self._store.blobs.checked(blob.hash) as file:
                    remote.send(blob, file)
                sent.append(blob.size)
            self._right[remote.address, blob] = True

        self._crew.each(deliver, _blobs(entry.files))
        remote.put_entry(entry.key, entry.spell())
        return sum(sent)


def _blobs(files: Iterable[File]) -> list[Digest]:
    """The blobs of a whole entry, whose sizes are all known."""
    return list(dict.fromkeys(Digest(file.digest, file.size or 0) for file in files))


def entry_at(remote: Remote, key: str) -> Entry | None:
    """The whole entry that a remote has under a key, or None; whether its blobs exist is not checked.

    Raises:
        RemoteFault: The remote failed.
    """
    message = remote.get_entry(key)
    if message is None:
        return None
    try:
        found = entries.read(message)
    except ValueError:
        return None
    return found if found.key == key and not found.is_bare else None

"""Downloads and uploads of one build, in the background."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from queue import Empty, SimpleQueue

from dextera_build.errors import StoreError
from dextera_build.remotes.breaker import GivenUp, Guarded
from dextera_build.remotes.remote import RemoteFault
from dextera_build.remotes.threads import Crew
from dextera_build.remotes.transfer import Transfer
from dextera_build.store.entry import ActionResult
from dextera_build.store.store import Store

_READERS = 16
_WRITERS = 4
_TICK_S = 0.02


@dataclass(frozen=True)
class Arrival:
    """The answer to one lookup."""

    key: str
    result: ActionResult | None
    """None: no remote has it, so it must be built."""
    is_whole: bool = True
    """Whether its bytes were downloaded, too."""
    remote: str = ""
    """Name of the remote that has it."""
    seconds: float = 0.0
    """Duration of the lookup [s]."""


@dataclass
class Upload:
    """The uploads to one remote."""

    remote: str
    results: int = 0
    octets: int = 0
    left: list[str] = field(default_factory=list)
    """Keys of results that were not uploaded."""
    reason: str = ""
    """Why the first of them was not uploaded."""


class Exchange:
    """The remotes of a build. Only the scheduling thread calls these methods.

    Args:
        store: The local store.
        remotes: The remotes, in lookup order.
    """

    def __init__(self, store: Store, remotes: Sequence[Guarded]) -> None:
        self.remotes = list(remotes)
        self._writing = [remote for remote in self.remotes if remote.may("write")]
        self._readers, self._writers = Crew(_READERS, "dxb fetch"), Crew(_WRITERS, "dxb upload")
        self._transfer = Transfer(store, self._readers)
        self._asked: set[str] = set()
        self._answers: SimpleQueue[Arrival] = SimpleQueue()
        self._guard = threading.Lock()
        self._uploads = {remote.name: Upload(remote.name) for remote in self._writing}
        self._to_send: dict[tuple[Guarded, str], None] = {}
        self.offered = 0
        """Number of uploads started."""

    @property
    def reads(self) -> bool:
        """Whether a remote may still be read."""
        return any(remote.may("read") for remote in self.remotes)

    def ask(self, key: str, *, whole: bool = True) -> None:
        """Look up a result in the background, with or without its bytes; `arrived` returns the answer later."""
        self._asked.add(key)
        self._readers.start(lambda: self._answer(key, whole))

    def arrived(self, patience_s: float) -> list[Arrival]:
        """Answers that have arrived, or arrive within `patience_s` [s]."""
        found = []
        with suppress(Empty):
            found.append(self._answers.get(timeout=patience_s) if patience_s else self._answers.get_nowait())
            while True:
                found.append(self._answers.get_nowait())
        for remote in self.remotes:
            remote.watch()
        if not self.reads:
            # Threads may hang in a remote that was given up; their lookups are answered here.
            found += [Arrival(key, None) for key in self._asked]
        fresh = {answer.key: answer for answer in reversed(found) if answer.key in self._asked}
        self._asked -= fresh.keys()
        return list(fresh.values())

    def offer(self, key: str) -> None:
        """Upload a result of the store in the background."""
        for remote in self._writing:
            with self._guard:
                self._to_send[remote, key] = None
            self.offered += 1
            self._writers.start(lambda remote=remote: self._send(remote, key))  # type: ignore[misc]

    def holds(self, key: str) -> bool:
        """Whether every remote that is written has a result already, with all its bytes."""
        try:
            return all(self._transfer.holds(remote, key) for remote in self._writing)
        except RemoteFault:
            return False

    def notices(self) -> list[GivenUp]:
        """Remotes that were given up since the last call."""
        found = [notice for remote in self.remotes for notice in remote.given_up]
        for remote in self.remotes:
            remote.given_up = []
        return found

    def wait(self, patience_s: float) -> int:
        """Wait at most `patience_s` [s] for uploads, and return how many are unfinished."""
        end = time.monotonic() + patience_s
        while True:
            for remote in self._writing:
                remote.watch()
            with self._guard:
                # Threads may hang in a remote that was given up.
                under_way = sum(remote.may("write") for remote, _ in self._to_send)
            if not under_way or time.monotonic() > end:
                return under_way
            time.sleep(_TICK_S)

    def close(self) -> list[Upload]:
        """Close connections, and return the finished uploads; unfinished ones are abandoned."""
        with self._guard:
            for remote, key in self._to_send:
                self._leave(remote, key, remote.reasons.get("write", "the build ended before"))
            self._to_send = {}
        for remote in self.remotes:
            remote.close()
        self._readers.dismiss()
        self._writers.dismiss()
        return [upload for upload in self._uploads.values() if upload.results or upload.left]

    def fetch(self, key: str, *, whole: bool = True) -> Arrival:
        """Look up a result in this thread."""
        began = time.monotonic()
        for remote in self.remotes:
            if not remote.may("read"):
                continue
            try:
                found = self._transfer.fetch(remote, key, whole=whole)
            except RemoteFault:
                continue  # the breaker counted it
            except StoreError:
                break  # a full disk, which the node will report
            if found is not None:
                return Arrival(key, found.result, found.is_whole, remote.name, time.monotonic() - began)
        return Arrival(key, None)

    def _answer(self, key: str, whole: bool) -> None:
        answer = Arrival(key, None)
        try:
            answer = self.fetch(key, whole=whole)
        finally:
            self._answers.put(answer)

    def _send(self, remote: Guarded, key: str) -> None:
        octets, reason = 0, ""
        try:
            octets = self._transfer.send(remote, key)
        except RemoteFault as fault:
            reason = fault.reason
        except StoreError as error:
            reason = error.message
        with self._guard:
            if (remote, key) not in self._to_send:
                return  # abandoned meanwhile
            del self._to_send[remote, key]
            if reason:
                self._leave(remote, key, reason)
            else:
                self._uploads[remote.name].results += 1
                self._uploads[remote.name].octets += octets

    def _leave(self, remote: Guarded, key: str, reason: str) -> None:
        upload = self._uploads[remote.name]
        upload.left.append(key)
        upload.reason = upload.reason or reason

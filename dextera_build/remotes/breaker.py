"""Limits what a failing remote costs a build to a few time-outs.

A request that fails is repeated once. If it fails again, or is refused, the remote is not used for the rest of the
build, and that is reported once. Reading and writing are given up separately: a read-only server can still be read.
"""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import BinaryIO, Literal, TypeVar

from dextera_build.errors import DxbError, StoreError
from dextera_build.remotes.remote import Digest, Remote, RemoteFault
from dextera_build.store.backoff import backoff

T = TypeVar("T")
Doing = Literal["read", "write"]

_DAMAGED = 3  # blobs with other bytes, after which nothing is read any more
_PAUSE_S = 0.2
_SLOWEST = 16 << 10  # bytes a second; slower transfers count as stalled
_UNDER_WAY = 4 << 20  # bytes that parallel transfers may hold before the first piece of any is handed on
_PATIENCE = 3  # an answer may take so many times the time-out, however it drips
_EACH_S = 0.05  # more for each blob of a long list
_OPENING_S = 30.0  # more before the first answer: a busy machine is slow to load what speaks to a remote


@dataclass(frozen=True)
class GivenUp:
    """A remote is no longer used."""

    remote: str
    """Its name."""
    address: str
    doing: Literal["read", "write", "both"]
    reason: str


class Guarded:
    """A remote with a circuit breaker; itself a `Remote`, for one build.

    Args:
        name: What people call the remote.
        address: What to show of where it is.
        opener: Connects; called when the remote is first needed.
        timeout_s: How long the remote waits for an answer [s].
        mode: `r`, `w` or `rw`.
    """

    def __init__(
        self, name: str, address: str, opener: Callable[[], Remote], *, timeout_s: float = 10.0, mode: str = "rw"
    ) -> None:
        self.name, self.address, self._timeout_s = name, address, timeout_s
        self.given_up: list[GivenUp] = []
        self.reasons: dict[Doing, str] = {}
        self._may: dict[Doing, bool] = {"read": "r" in mode, "write": "w" in mode}
        self._damaged = 0
        self._opener, self._remote = opener, None
        self._guard, self._opening = threading.Lock(), threading.Lock()
        self._under_way: dict[int, float] = {}
        self._numbers = itertools.count()

    _remote: Remote | None

    def may(self, doing: Doing) -> bool:
        """Whether the remote is still asked."""
        return self._may[doing]

    def get_entry(self, key: str) -> bytes | None:
        """As `Remote`."""
        return self._call("read", lambda remote, _: remote.get_entry(key))

    def put_entry(self, key: str, message: bytes) -> None:
        """As `Remote`."""
        self._call("write", lambda remote, _: remote.put_entry(key, message), len(message))

    def missing(self, digests: Sequence[Digest]) -> set[Digest]:
        """As `Remote`; asked before writing."""
        return self._call("write", lambda remote, _: remote.missing(digests), 0, len(digests))

    def fetch(self, digests: Sequence[Digest], take: Callable[[Digest, Iterator[bytes]], None]) -> None:
        """As `Remote`; the second try asks for what has not come.

        Sizes are claims of the remote, so its time grows with the bytes that came, not with those it announced.
        """
        came: set[Digest] = set()

        def work(remote: Remote, number: int) -> None:
            def note(digest: Digest, pieces: Iterator[bytes]) -> None:
                take(digest, self._timed(number, pieces))
                came.add(digest)

            remote.fetch([digest for digest in digests if digest not in came], note)

        octets = sum(digest.size for digest in digests)
        self._call("read", work, min(octets, _UNDER_WAY), len(digests))

    def send(self, digests: Sequence[Digest], give: Callable[[Digest], BinaryIO]) -> None:
        """As `Remote`."""
        octets = sum(digest.size for digest in digests)
        self._call("write", lambda remote, _: remote.send(digests, give), octets, len(digests))

    def aside(self, work: Callable[[Remote], T]) -> T | None:
        """The answer to a question that precedes an upload; None if it fails, since an upload can do without."""
        if not self._may["write"]:
            return None
        try:
            return self._watched(lambda remote, _: work(remote), _PATIENCE * self._timeout_s)
        except RemoteFault:
            return None

    def close(self) -> None:
        """Stop using the remote, and close its connections."""
        self._may = {"read": False, "write": False}
        if self._remote is not None:
            self._remote.close()

    def blame(self, fault: RemoteFault) -> None:
        """Count a blob that came with other bytes; after a few of them nothing is read any more."""
        with self._guard:
            self._damaged += 1
            if self._damaged >= _DAMAGED:
                self._give_up("read", fault.reason)

    def watch(self) -> None:
        """Give the remote up if a call takes longer than it may, and end that call."""
        now = time.monotonic()
        with self._guard:
            late = any(now > deadline for deadline in self._under_way.values()) and any(self._may.values())
            if late:
                self._give_up("both", "it answers too slowly")
        if late:
            self.close()

    def _timed(self, number: int, pieces: Iterator[bytes]) -> Iterator[bytes]:
        for piece in pieces:
            with self._guard:
                if number in self._under_way:  # else the call was given up meanwhile
                    self._under_way[number] += len(piece) / _SLOWEST
            yield piece

    def _call(self, doing: Doing, work: Callable[[Remote, int], T], octets: int = 0, parts: int = 1) -> T:
        patience = _PATIENCE * self._timeout_s + octets / _SLOWEST + parts * _EACH_S
        for last in (False, True):
            if not self._may[doing]:
                raise RemoteFault(self.address, self.reasons.get(doing, "it is not used"))
            try:
                return self._watched(work, patience)
            except RemoteFault as fault:
                if last or fault.refused:
                    # A server that says no to one may say yes to the other; one that is away is away for both.
                    with self._guard:
                        self._give_up(doing if fault.refused else "both", fault.reason)
                    raise
                time.sleep(backoff(1, _PAUSE_S))
        raise AssertionError("a second try returns or raises")

    def _watched(self, work: Callable[[Remote, int], T], patience_s: float) -> T:
        number = next(self._numbers)
        with self._guard:
            self._under_way[number] = time.monotonic() + patience_s + _OPENING_S
        try:
            remote = self._connected()
            with self._guard:
                self._under_way[number] = time.monotonic() + patience_s
            return work(remote, number)
        except (RemoteFault, StoreError, KeyboardInterrupt, SystemExit, GeneratorExit):
            raise
        # An undeclared exception of a library must not end a build; panics of Rust are no `Exception`.
        except BaseException as error:
            reason = f"{type(error).__name__}: {str(error).partition(chr(10))[0]}"
            raise RemoteFault(self.address, reason) from error
        finally:
            with self._guard:
                del self._under_way[number]

    def _connected(self) -> Remote:
        with self._opening:
            if self._remote is None:
                try:
                    self._remote = self._opener()
                except DxbError as error:
                    because = error.facts.get("because") or error.hint
                    more = f" ({because})" if because else ""
                    raise RemoteFault(self.address, f"{error.message}{more}", refused=True) from None
            return self._remote

    def _give_up(self, doing: Literal["read", "write", "both"], reason: str) -> None:
        each: tuple[Doing, ...] = ("read", "write") if doing == "both" else (doing,)
        if any(self._may[one] for one in each):
            self.given_up.append(GivenUp(self.name, self.address, doing, reason))
        for one in each:
            self._may[one] = False
            self.reasons.setdefault(one, reason)

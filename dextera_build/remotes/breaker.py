"""Limits the cost of a failing remote to a few timeouts per build.

A request that fails is repeated once. If it fails again, or is refused, the remote is not used for the rest of the
build, and that is reported once. Reading and writing are given up separately: a read-only server can still be read.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from typing import BinaryIO, Literal, NamedTuple

from dextera_build.errors import DxbError, StoreError
from dextera_build.remotes.remote import Digest, Remote, RemoteFault, T

Doing = Literal["read", "write"]
_BOTH: tuple[Doing, ...] = ("read", "write")

_DAMAGED = 3  # blobs with wrong bytes after which the remote is not read any more
_PAUSE_S = 0.2
_SLOWEST = 16 << 10  # bytes a second; slower transfers count as stalled
_PATIENCE = 3  # an answer may take this many timeouts in all, even if bytes trickle in


class GivenUp(NamedTuple):
    """A remote is no longer used."""

    remote: str
    """Its name."""
    address: str
    doing: Literal["read", "write", "both"]
    reason: str


class Guarded(Remote):
    """A remote with a circuit breaker; itself a `Remote`, for one build.

    Args:
        name: Name of the remote.
        address: Its address, as shown to users.
        opener: Connects; called when the remote is first needed.
        timeout_s: How long the remote waits for an answer [s].
        mode: `r`, `w` or `rw`.
    """

    def __init__(
        self, name: str, address: str, opener: Callable[[], Remote], *, timeout_s: float = 10.0, mode: str = "rw"
    ) -> None:
        self.name, self.address = name, address
        self.given_up: list[GivenUp] = []
        self.reasons: dict[Doing, str] = {}
        """Why the remote is no longer read or written."""
        self._mode, self._patience_s = mode, _PATIENCE * timeout_s
        self._damaged = 0
        self._opener, self._remote = opener, None
        self._guard, self._opening = threading.Lock(), threading.Lock()
        self._deadlines: dict[int, float] = {}
        """Thread -> time at which its current call counts as stalled."""

    _remote: Remote | None

    def may(self, doing: Doing) -> bool:
        """Whether the remote is still read or written."""
        return doing[0] in self._mode and doing not in self.reasons

    def get_entry(self, key: str) -> bytes | None:
        """As `Remote`."""
        return self._call("read", lambda remote: remote.get_entry(key))

    def put_entry(self, key: str, message: bytes) -> None:
        """As `Remote`."""
        self._call("write", lambda remote: remote.put_entry(key, message), len(message))

    def has(self, digest: Digest) -> bool:
        """As `Remote`; used before writing."""
        return self._call("write", lambda remote: remote.has(digest))

    def fetch(self, digest: Digest, take: Callable[[Iterator[bytes]], bool]) -> bool | None:
        """As `Remote`; after a few blobs with wrong bytes, the remote is not read any more.

        Announced sizes are not trusted, so the deadline grows with the bytes received.
        """
        right = self._call("read", lambda remote: remote.fetch(digest, lambda pieces: take(self._timed(pieces))))
        if right is False:
            with self._guard:
                self._damaged += 1
                if self._damaged >= _DAMAGED:
                    self._give_up("read", f"blob `{digest.hash[:12]}` does not match its digest")
        return right

    def send(self, digest: Digest, file: BinaryIO) -> None:
        """As `Remote`."""

        def work(remote: Remote) -> None:
            file.seek(0)
            remote.send(digest, file)

        self._call("write", work, digest.size)

    def close(self) -> None:
        """Stop using the remote, and close its connections."""
        for doing in _BOTH:
            self.reasons.setdefault(doing, "it is not used")
        if self._remote is not None:
            self._remote.close()

    def watch(self) -> None:
        """Give the remote up if a call exceeds its deadline, and abort that call."""
        now = time.monotonic()
        with self._guard:
            late = any(now > deadline for deadline in self._deadlines.values()) and len(self.reasons) < 2
            if late:
                self._give_up("both", "it answers too slowly")
        if late:
            self.close()

    def _timed(self, pieces: Iterator[bytes]) -> Iterator[bytes]:
        for piece in pieces:
            with self._guard:
                self._deadlines[threading.get_ident()] += len(piece) / _SLOWEST
            yield piece

    def _call(self, doing: Doing, work: Callable[[Remote], T], octets: int = 0) -> T:
        for last in (False, True):
            if doing in self.reasons:
                raise RemoteFault(self.address, self.reasons[doing])
            try:
                return self._watched(work, self._patience_s + octets / _SLOWEST)
            except RemoteFault as fault:
                if last or fault.refused:
                    # A server may refuse reading or writing alone; an unreachable one can do neither.
                    with self._guard:
                        self._give_up(doing if fault.refused else "both", fault.reason)
                    raise
                time.sleep(_PAUSE_S)
        raise AssertionError("a second try returns or raises")

    def _watched(self, work: Callable[[Remote], T], patience_s: float) -> T:
        thread = threading.get_ident()
        try:
            remote = self._connected()  # not timed: a busy machine imports client libraries slowly
            with self._guard:
                self._deadlines[thread] = time.monotonic() + patience_s
            return work(remote)
        except (RemoteFault, StoreError, KeyboardInterrupt, SystemExit, GeneratorExit):
            raise
        # An undeclared exception of a library must not end a build; a Rust panic is not an `Exception`.
        except BaseException as error:
            reason = f"{type(error).__name__}: {str(error).partition(chr(10))[0]}"
            raise RemoteFault(self.address, reason) from error
        finally:
            with self._guard:
                self._deadlines.pop(thread, None)

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
        each = _BOTH if doing == "both" else (doing,)
        if any(map(self.may, each)):
            self.given_up.append(GivenUp(self.name, self.address, doing, reason))
        for one in each:
            self.reasons.setdefault(one, reason)

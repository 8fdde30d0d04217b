"""Notices that a transfer stands still: a long one may take hours, but a piece of it only as long as any answer."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import TracebackType


class Stall:
    """Watches one transfer while the block is open.

    Args:
        cancel: Ends the transfer; called from another thread, once.
        patience_s: How long one wait may take [s]; it is noticed within twice that.
    """

    def __init__(self, cancel: Callable[[], object], patience_s: float) -> None:
        self.happened = False
        self._cancel = cancel
        self._patience_s = patience_s
        self._waits = 0
        self._waiting = 0
        self._guard = threading.Lock()
        self._over = threading.Event()

    def __enter__(self) -> Stall:
        threading.Thread(target=self._watch, name="dxb stall", daemon=True).start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()

    @contextmanager
    def waiting(self) -> Iterator[None]:
        """While the block is open, it is the other side's turn."""
        with self._guard:
            self._waits += 1
            self._waiting += 1
        try:
            yield
        finally:
            with self._guard:
                self._waiting -= 1

    def _watch(self) -> None:
        seen = -1
        while not self._over.wait(self._patience_s):
            if self._waiting and self._waits == seen:
                self.happened = True
                self._cancel()
                return
            seen = self._waits

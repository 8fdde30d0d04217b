"""Threads that work through the worlds of one process. MuJoCo releases the interpreter's lock while it simulates."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")


class Threads:
    """Calls a function for every world; which thread takes which is left to chance.

    Args:
        count: Number of threads; None: one per core that this process may use.
        most: Number of worlds, beyond which more threads have nothing to do.
    """

    def __init__(self, count: int | None, most: int) -> None:
        self.count = max(1, min(most, count or len(os.sched_getaffinity(0))))
        """Number of threads, with the one that calls."""
        self._pool = ThreadPoolExecutor(self.count - 1) if self.count > 1 else None

    def each(self, work: Callable[[int], T], worlds: int) -> list[T]:
        """The results for the worlds 0 to `worlds` - 1, in order."""
        if self._pool is None:
            return [work(number) for number in range(worlds)]
        found: dict[int, T] = {}
        # One future per thread rather than per world: a future takes as long as the observation of a world.
        left = iter(range(worlds))

        def take() -> None:
            for number in left:
                found[number] = work(number)

        others = [self._pool.submit(take) for _ in range(self.count - 1)]
        take()
        for each in others:
            each.result()
        return [found[number] for number in range(worlds)]

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()

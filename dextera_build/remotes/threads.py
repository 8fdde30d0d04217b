"""Threads that wait for other machines, so that nothing else does."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Sequence
from queue import SimpleQueue
from typing import TypeVar

T = TypeVar("T")


class Crew:
    """At most `size` threads that carry out jobs; made as they are needed.

    They are daemons: a share that hangs must not keep dxb from ending.

    Args:
        size: How many threads.
        name: What they are called in a debugger.
    """

    def __init__(self, size: int, name: str) -> None:
        self.size = size
        self._name = name
        self._jobs: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._guard = threading.Lock()
        self._threads = 0
        self._idle = 0

    def start(self, job: Callable[[], None]) -> None:
        """Carry out `job` when a thread is free; it must not raise."""
        with self._guard:
            if self._idle > 0:
                self._idle -= 1
            elif self._threads < self.size:
                self._threads += 1
                threading.Thread(target=self._work, name=self._name, daemon=True).start()
        self._jobs.put(job)

    def each(self, work: Callable[[T], None], items: Sequence[T]) -> None:
        """Do `work` for every item, in this thread and those that are free; the first error ends it and is raised."""
        todo, errors = deque(items), list[BaseException]()
        changed, active = threading.Condition(), [0]

        def next_of() -> tuple[T] | None:
            with changed:
                return (todo.popleft(),) if todo else None

        def drain() -> None:
            with changed:
                active[0] += 1
            try:
                while not errors and (item := next_of()) is not None:
                    work(item[0])
            except BaseException as error:
                errors.append(error)
            finally:
                with changed:
                    active[0] -= 1
                    changed.notify_all()

        for _ in range(min(self.size, len(items) - 1)):
            self.start(drain)
        drain()
        with changed:
            changed.wait_for(lambda: active[0] == 0)
        if errors:
            raise errors[0]

    def dismiss(self) -> None:
        """Let idle threads end; jobs that wait are still done."""
        with self._guard:
            for _ in range(self._threads):
                self._jobs.put(None)

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            job()
            with self._guard:
                self._idle += 1

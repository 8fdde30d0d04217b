"""Thread pools for requests to other machines."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from queue import SimpleQueue
from typing import TypeVar

T = TypeVar("T")


class Crew:
    """A pool of at most `size` threads; each of the first jobs starts one.

    They are daemons: a share that hangs must not keep dxb from exiting.

    Args:
        size: Most threads.
        name: Their name in a debugger.
    """

    def __init__(self, size: int, name: str) -> None:
        self._size, self._name = size, name
        self._jobs: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._guard = threading.Lock()
        self._threads = 0

    def start(self, job: Callable[[], None]) -> None:
        """Run `job` when a thread is free; it must not raise."""
        with self._guard:
            if self._threads < self._size:
                self._threads += 1
                threading.Thread(target=self._work, name=self._name, daemon=True).start()
        self._jobs.put(job)

    def each(self, work: Callable[[T], None], items: Sequence[T]) -> None:
        """Call `work` for every item, in this thread and in free ones; stop at the first error and raise it."""
        todo, errors = iter(items), list[BaseException]()
        changed, active = threading.Condition(), set[int]()

        def drain() -> None:
            with changed:
                active.add(threading.get_ident())
            try:
                for item in todo:
                    if errors:
                        break
                    work(item)
            except BaseException as error:
                errors.append(error)
            with changed:
                active.remove(threading.get_ident())
                changed.notify_all()

        for _ in range(min(self._size, len(items) - 1)):
            self.start(drain)
        drain()
        with changed:
            changed.wait_for(lambda: not active)
        if errors:
            raise errors[0]

    def dismiss(self) -> None:
        """Let idle threads end; queued jobs still run."""
        with self._guard:
            for _ in range(self._threads):
                self._jobs.put(None)

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            job()

"""A camera of a simulated robot in a thread of its own: a frame takes longer than the joint states may wait."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Self

import mujoco
import numpy as np

from dextera_build.policy.observation import Frames
from dextera_build.sim.runtime.environment import Environment

Opens = Callable[[Environment], AbstractContextManager[Callable[[], Frames]]]
"""Opens the cameras of a world, and gives what they show."""
END_S = 10.0
"""Longest time until the last frame is made [s]."""


class Apart:
    """Makes frames of a world that goes on; one that is due while another is made is left out.

    Args:
        environment: The world, in which an episode was begun.
        opens: Opens its cameras, in the thread that renders.
    """

    def __init__(self, environment: Environment, opens: Opens) -> None:
        self._there, self._opens = environment, opens
        self._wakes, self._ready = threading.Condition(), threading.Event()
        self._asked: tuple[np.ndarray, Callable[[Frames], None]] | None = None
        self._busy, self._ended = False, False
        self.fault: BaseException | None = None
        """What ended the thread, if it was not asked to."""
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)

    def __enter__(self) -> Self:
        """Begin; the first frame is made here, because it takes long.

        Raises:
            Exception: The camera cannot be opened.
        """
        self._thread.start()
        self._ready.wait()
        if self.fault is not None:
            raise self.fault
        return self

    def __exit__(self, *error: object) -> None:
        """End; nothing is shown afterwards."""
        with self._wakes:
            self._ended = True
            self._wakes.notify()
        self._thread.join(END_S)

    def ask(self, show: Callable[[Frames], None]) -> None:
        """Have the present state shown by `show`, in another thread, unless a frame is being made.

        Raises:
            Exception: A frame could not be made.
        """
        if self.fault is not None:
            raise self.fault
        with self._wakes:
            if not self._busy:
                self._busy, self._asked = True, (self._there.data.qpos.copy(), show)
                self._wakes.notify()

    def _run(self) -> None:
        try:
            world = Environment(self._there.bundle)
            world.begin(self._there.start)
            with self._opens(world) as look:
                look()
                self._ready.set()
                while (asked := self._next()) is not None:
                    world.data.qpos[:] = asked[0]
                    mujoco.mj_forward(world.model, world.data)
                    asked[1](look())
                    self._busy = False
        except BaseException as fault:  # the thread that asks raises it
            self.fault = fault
        self._ready.set()

    def _next(self) -> tuple[np.ndarray, Callable[[Frames], None]] | None:
        """The next state to show; None at the end."""
        with self._wakes:
            self._wakes.wait_for(lambda: self._asked is not None or self._ended)
            asked, self._asked = self._asked, None
            return None if self._ended else asked

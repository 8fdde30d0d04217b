"""The state of every node, and the one place where it changes.

                 sources known            key is in the cache
      WAITS ------------------> READY ------------------------> DONE
        ^                         |  ^                          ^ ^
        |                     key |  | the other                | |
        |                  misses |  | one ended    a remote    | |
        |                         |  |              has it      | |
        |                         |  +- SHARED   +--------------+ |
        | bytes of an input       |     ^        |                |
        | are gone                +-----+--> FETCHING          ok |
        |                         |              |                |
        |                         v  no remote   |                |
        |                         |  has it      |                |
        +-----------------  QUEUED <-------------+     +----------+
                             |  ^  |  room             |
         another process     v  |  +--------------> RUNNING ---> FAILED
         builds this key   LOCKED                         error

      WAITS -> BLOCKED     a source failed, or is blocked itself
      FETCHING -> FAILED   no remote has it, and it may not run
      READY, FETCHING -> WAITS     it must run, and bytes of an input are absent
      RUNNING -> QUEUED    it failed, and its rule declares more tries
      any but RUNNING -> CANCELLED     the run ended before its turn
      READY -> STALE       a dry run would have to run it
      DONE -> WAITS        its bytes were lost; it is made again

WAITS and READY are also the states of openings and gatherings, which are DONE without running.
"""

from __future__ import annotations

import enum
from collections import deque
from typing import Generic, Protocol, TypeVar, cast


class State(enum.Enum):
    """See the picture above."""

    # The hash of `Enum` is a Python function, and states are looked up all the time.
    __hash__ = object.__hash__

    WAITS = "waits"
    """Some source is not known yet. `Unit.pending` counts them."""
    READY = "ready"
    """Every source is known; in `States.ready`."""
    SHARED = "shared"
    """Another node of this run has the same key and builds it."""
    QUEUED = "queued"
    """The key is not in the cache; in `States.queue` until there is room."""
    FETCHING = "fetching"
    """Remotes are asked for the key's result; counted in `States.fetching`."""
    LOCKED = "locked"
    """Another process builds the key; in `States.locked`."""
    RUNNING = "running"
    """With the executor; this process holds the key's lock."""
    DONE = "done"
    """The output is known and in the store."""
    FAILED = "failed"
    """It has an error of its own."""
    BLOCKED = "blocked"
    """It never ran because of `Unit.blockers`."""
    CANCELLED = "cancelled"
    """It never ran because the run ended."""
    STALE = "stale"
    """Only in a dry run: it would run."""


_NEXT: dict[State, frozenset[State]] = {
    State.WAITS: frozenset({State.READY, State.FAILED, State.BLOCKED, State.CANCELLED}),
    State.READY: frozenset(set(State) - {State.LOCKED, State.RUNNING}),
    State.SHARED: frozenset({State.READY, State.DONE, State.FAILED, State.BLOCKED, State.CANCELLED}),
    State.QUEUED: frozenset({State.RUNNING, State.LOCKED, State.DONE, State.FAILED, State.CANCELLED}),
    State.FETCHING: frozenset({State.QUEUED, State.DONE, State.FAILED, State.WAITS, State.CANCELLED}),
    State.LOCKED: frozenset({State.QUEUED, State.DONE, State.CANCELLED}),
    State.RUNNING: frozenset({State.QUEUED, State.DONE, State.FAILED, State.WAITS, State.CANCELLED}),
    State.DONE: frozenset({State.WAITS}),
    State.FAILED: frozenset(),
    State.BLOCKED: frozenset(),
    State.CANCELLED: frozenset(),
    State.STALE: frozenset(),
}

LOST = frozenset({State.FAILED, State.BLOCKED, State.CANCELLED})
"""States that no output will ever come from."""


class Stateful(Protocol):
    """Something with a state."""

    state: State


U = TypeVar("U", bound=Stateful)
"""A unit."""
N = TypeVar("N", bound=Stateful)
"""A node, which is a unit that may run."""


class States(Generic[U, N]):
    """The states of all units of one run, with the queues that follow from them."""

    def __init__(self) -> None:
        self.ready: deque[U] = deque()
        self.queue: deque[N] = deque()
        self.locked: list[N] = []
        self.running = 0
        self.fetching = 0

    def set(self, unit: U, state: State) -> None:
        """Every change of state goes through here.

        Raises:
            AssertionError: The picture has no such arrow.
        """
        old = unit.state
        if state not in _NEXT[old]:
            raise AssertionError(f"{unit}: {old.value} -> {state.value}")
        if old is State.LOCKED:
            self.locked.remove(cast("N", unit))
        self.running += (state is State.RUNNING) - (old is State.RUNNING)
        self.fetching += (state is State.FETCHING) - (old is State.FETCHING)
        unit.state = state
        if state is State.READY:
            self.ready.append(unit)
        elif state is State.QUEUED:
            self.queue.append(cast("N", unit))
        elif state is State.LOCKED:
            self.locked.append(cast("N", unit))

    def next_ready(self) -> U | None:
        """Take the next unit whose sources are known."""
        while self.ready:
            unit = self.ready.popleft()
            if unit.state is State.READY:
                return unit
        return None

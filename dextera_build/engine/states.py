"""The states of a node and the transitions between them.

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
      RUNNING -> QUEUED    it failed, and its rule allows a retry
      any but RUNNING -> CANCELLED     the run ended before its turn
      READY -> STALE       a build would have to run it (dry run only)
      DONE -> WAITS        its bytes were lost; it is rebuilt

WAITS and READY are also the states of openings and gatherings, which are DONE without running.
"""

from __future__ import annotations

import enum


class State(enum.Enum):
    """See the diagram above."""

    # `Enum.__hash__` is a Python function, too slow for lookups this frequent.
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
    """It failed with its own error."""
    BLOCKED = "blocked"
    """It never ran because a source failed, or is blocked itself."""
    CANCELLED = "cancelled"
    """It never ran because the run ended."""
    STALE = "stale"
    """Only in a dry run: it would run."""


NEXT: dict[State, frozenset[State]] = {
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
"""States that never lead to an output."""

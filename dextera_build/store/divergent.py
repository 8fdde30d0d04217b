"""Keys whose reruns gave other outputs: the first output stays, and the others are recorded."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass

from dextera_build import digest as digests
from dextera_build.store import failpoints
from dextera_build.store.state import State

_KIND = "divergent"
_MOST = 16
"""Most outputs recorded for one key."""


@dataclass(frozen=True)
class Divergence:
    """One key with more than one output."""

    key: str
    node: str
    """Address of the node that ran again, with its recipe if known."""
    first: str
    """Digest of the output that the store serves."""
    again: tuple[str, ...]
    """Digests of the other outputs, oldest first."""
    time: float
    """Time of the latest one (seconds since the epoch)."""


class Divergent:
    """The divergent keys known on this machine.

    Args:
        state: Holds the records.
    """

    def __init__(self, state: State) -> None:
        self._state = state

    def note(self, key: str, node: str, first: str, again: str, time: float) -> None:
        """Record that `key` gave `again` although the store has `first`; a read-only store records nothing."""
        known = self.get(key)
        others = known.again if known and known.first == first else ()
        if again not in others and len(others) < _MOST:
            others = (*others, again)
        self._state.put(_KIND, {key: json.dumps([node, first, others, time]).encode()})
        failpoints.reach("result.diverged")

    def get(self, key: str) -> Divergence | None:
        """The record of a key, or None."""
        row = self._state.get(_KIND, key)
        return _parsed(key, row) if row is not None else None

    def all(self) -> Iterator[Divergence]:
        """All records, newest first."""
        found = [known for key, row in self._state.all(_KIND).items() if (known := _parsed(key, row)) is not None]
        yield from sorted(found, key=lambda known: -known.time)


def _parsed(key: str, row: bytes) -> Divergence | None:
    with suppress(ValueError):
        match digests.plain(row):
            case [str(node), str(first), [*again], int() | float() as time] if all(
                isinstance(one, str) for one in again
            ):
                return Divergence(key, node, first, tuple(again), time)
    return None

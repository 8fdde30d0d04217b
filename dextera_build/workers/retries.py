"""Which failures are worth another try: those of the machine and of what stands behind a network, never a bad input."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from dextera_build.errors import DxbError, MachineError

_DIED = "DXB-B301"
_OF_CLUSTERS = ("DXB-E354", "DXB-E355")
"""A cluster lost the worker of a call; the remote that its machines share does not work."""
_MOST_LOST = 2
"""Tries after the first for these two, whatever the rule declares."""


@dataclass(frozen=True)
class Retries:
    """What a rule declares."""

    most: int = 0
    """Tries after the first."""
    on: tuple[str, ...] = ()
    """Exceptions that count beside a dead worker and a `MachineError`, as `name_of` spells them."""
    wait_s: float = 1.0
    """Before the second try; twice as long before each further one."""

    def again(self, tries: int, error: DxbError, raised: Iterable[str]) -> bool:
        """Whether a node that has failed `tries` times shall be tried again.

        Args:
            tries: How often it has run.
            error: What it failed of the last time.
            raised: The exception that the rule let escape, with its bases; empty where it was a `DxbError`.
        """
        if error.code in _OF_CLUSTERS and tries <= _MOST_LOST:
            return True
        if tries > self.most:
            return False
        return error.code == _DIED or isinstance(error, MachineError) or not set(self.on).isdisjoint(raised)


def name_of(kind: type[BaseException]) -> str:
    """`ConnectionError`, `httpx.TransportError`."""
    return kind.__qualname__ if kind.__module__ == "builtins" else f"{kind.__module__}.{kind.__qualname__}"


def names_of(error: BaseException) -> list[str]:
    """The exception and its bases down to `Exception`."""
    return [name_of(kind) for kind in type(error).__mro__ if issubclass(kind, Exception)]

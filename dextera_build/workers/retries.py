"""Retry policy: failures of the machine or the network are retried, bad inputs never."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from dextera_build.errors import DxbError, MachineError

_DIED = "DXB-B301"
_OF_CLUSTERS = ("DXB-E354", "DXB-E355")
"""A cluster lost the worker of a call; the remote shared by its machines does not work."""
_MOST_LOST = 2
"""Maximum number of retries for these two errors, regardless of the rule."""


@dataclass(frozen=True)
class Retries:
    """Retry settings of a rule."""

    most: int = 0
    """Maximum number of retries."""
    on: tuple[str, ...] = ()
    """Exceptions to retry, as named by `name_of`, in addition to a dead worker and a `MachineError`."""
    wait_s: float = 1.0
    """Delay before the second try [s]; doubled before each further one."""

    def again(self, tries: int, error: DxbError, raised: Iterable[str]) -> bool:
        """Whether to retry a node that has failed `tries` times.

        Args:
            tries: Number of runs so far.
            error: Error of the last run.
            raised: Names of the exception that escaped the rule and of its bases; empty for a `DxbError`.
        """
        if error.code in _OF_CLUSTERS and tries <= _MOST_LOST:
            return True
        if tries > self.most:
            return False
        return error.code == _DIED or isinstance(error, MachineError) or not set(self.on).isdisjoint(raised)


def name_of(kind: type[BaseException]) -> str:
    """Name of an exception type: `ConnectionError`, `httpx.TransportError`."""
    return kind.__qualname__ if kind.__module__ == "builtins" else f"{kind.__module__}.{kind.__qualname__}"


def names_of(error: BaseException) -> list[str]:
    """Names of the exception's type and its bases up to `Exception`."""
    return [name_of(kind) for kind in type(error).__mro__ if issubclass(kind, Exception)]

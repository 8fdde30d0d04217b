"""Servers that a worker keeps for its next nodes."""

from __future__ import annotations

from collections.abc import Callable, Hashable

from dextera_build.outside.running import Running

_KEPT: dict[Hashable, Running] = {}
"""The server of this process; one at most, because each may hold a model in memory."""


def kept(key: Hashable, start: Callable[[], Running]) -> Running:
    """The server with this key, started if it is not alive; a server with another key ends first."""
    found = _KEPT.get(key)
    if found is not None and found.is_alive:
        return found
    end()
    _KEPT[key] = start()
    return _KEPT[key]


def end() -> None:
    """End the server of this process."""
    while _KEPT:
        _KEPT.popitem()[1].end()

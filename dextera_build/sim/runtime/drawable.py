"""The next seed whose start can be drawn, for who needs some start and not that of one seed."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from dextera_build.errors import RuleError

T = TypeVar("T")
TRIES = 10
"""Most seeds that are tried for one start."""


def drawable(draw: Callable[[int], T], seed: int) -> T:
    """What `draw` gives for `seed`, or for the first seed after it whose start can be drawn.

    Raises:
        RuleError: None of `TRIES` starts can be drawn.
    """
    for further in range(TRIES - 1):
        try:
            return draw(seed + further)
        except RuleError:  # no start without collisions
            continue
    return draw(seed + TRIES - 1)

"""Seeds of episodes, derived from their purpose, not from the order of random draws."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from dextera_build import digest
from dextera_build.errors import RuleError

T = TypeVar("T")
TRIES = 10
"""Most seeds that are tried for one start."""


def seed_of(*parts: int | str) -> int:
    """A 63-bit seed from the names of its purpose: `seed_of(7, "train", 12)`."""
    return int(digest.of_value(list(parts))[:16], 16) >> 1


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

"""Seeds of episodes: by content, not by the order in which random numbers were drawn."""

from __future__ import annotations

from dextera_build import digest


def seed_of(*parts: int | str) -> int:
    """A seed of 63 bits from the names of its use: `seed_of(7, "train", 12)`."""
    return int(digest.of_value(list(parts))[:16], 16) >> 1

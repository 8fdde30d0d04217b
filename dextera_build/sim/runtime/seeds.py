"""Seeds of episodes, derived from their purpose, not from the order of random draws."""

from __future__ import annotations

from dextera_build import digest


def seed_of(*parts: int | str) -> int:
    """A 63-bit seed from the names of its purpose: `seed_of(7, "train", 12)`."""
    return int(digest.of_value(list(parts))[:16], 16) >> 1

"""How long to wait before something is tried again."""

from __future__ import annotations

_LONGEST_S = 60.0


def backoff(tries: int, wait_s: float, key: str = "") -> float:
    """The wait after so many failed tries [s]: `wait_s` after the first, and twice as long after each further one.

    Args:
        tries: How many failed.
        wait_s: The first wait [s].
        key: A digest that spreads the wait over half of its length, so that what failed together does not come back
            together.
    """
    spread = int(key[:8], 16) / 2**32 if key else 1.0
    return min(wait_s * 2.0 ** (tries - 1), _LONGEST_S) * (0.5 + 0.5 * spread)

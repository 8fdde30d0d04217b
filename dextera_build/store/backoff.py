"""Exponential backoff between retries."""

from __future__ import annotations

_LONGEST_S = 60.0


def backoff(tries: int, wait_s: float, key: str = "") -> float:
    """Return the wait after `tries` failures [s]: `wait_s` after the first, doubled after each further one.

    Args:
        tries: Number of failed attempts.
        wait_s: The first wait [s].
        key: A digest that scales the wait to 50-100 %, which spreads out retries of calls that failed together.
    """
    spread = int(key[:8], 16) / 2**32 if key else 1.0
    return min(wait_s * 2.0 ** (tries - 1), _LONGEST_S) * (0.5 + 0.5 * spread)

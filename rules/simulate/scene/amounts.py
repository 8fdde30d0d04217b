"""Numbers of things in one word or in several."""

from __future__ import annotations


def amount(number: int, one: str, several: str = "") -> str:
    """`1 joint`, `2 joints`; `several` is an irregular plural."""
    return f"{number} {one if number == 1 else several or one + 's'}"

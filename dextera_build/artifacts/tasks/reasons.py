"""Counting and formatting of the reasons of failed attempts."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping

_MEASURED = re.compile(r"\d+ (mm|deg)\b")


def tally(reasons: Iterable[str]) -> dict[str, int]:
    """Reason -> count, most frequent first; reasons that differ only in measured numbers are merged: `by N mm`."""
    return dict(Counter(_MEASURED.sub(r"N \1", reason) for reason in reasons).most_common())


def spelled(counts: Mapping[str, int], most: int) -> str:
    """`12 x slipped, 3 x out of reach, 2 x others`, most frequent first, at most `most` by name."""
    ordered = sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    rest = sum(count for _, count in ordered[most:])
    shown = [f"{count} x {reason}" for reason, count in ordered[:most]]
    return ", ".join([*shown, *([f"{rest} x others"] if rest else [])])

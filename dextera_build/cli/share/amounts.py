"""Amounts that people write: `50GB`, `30d`."""

from __future__ import annotations

import re

from dextera_build.errors import UsageError, listing

SIZES = {"B": 1, **{f"{letter}B": 1000**n for n, letter in enumerate("KMGT", 1)}} | {
    f"{letter}iB": 1024**n for n, letter in enumerate("KMGT", 1)
}
TIMES = {"s": 1, "min": 60, "h": 3600, "d": 86400, "w": 7 * 86400}

_FORM = re.compile(r"(\d+(?:\.\d+)?)\s*([A-Za-z]+)")


def size(text: str) -> int:
    """Bytes in `50GB` or `1.5 GiB`.

    Raises:
        UsageError: It is not a size.
    """
    return round(_read(text, SIZES, "a size", "50GB"))


def seconds(text: str) -> float:
    """Seconds in `30d` or `12h`.

    Raises:
        UsageError: It is not a time.
    """
    return _read(text, TIMES, "a time", "30d")


def _read(text: str, units: dict[str, int], what: str, example: str) -> float:
    found = _FORM.fullmatch(text.strip())
    known = {unit.lower(): factor for unit, factor in units.items()}
    if found is None or found[2].lower() not in known:
        raise UsageError(
            f"`{text}` is not {what}", code="DXB-U150", facts={"units": listing(units)}, hint=f"write it as `{example}`"
        )
    return float(found[1]) * known[found[2].lower()]

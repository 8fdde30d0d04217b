"""Sizes and durations on the command line: `50GB`, `30d`."""

from __future__ import annotations

import re

from dextera_build.errors import UsageError, listing

_SIZES: dict[str, int] = {f"{letter}B": 1000**n for n, letter in enumerate(["", *"KMGT"])}
_SIZES |= {f"{letter}iB": 1024**n for n, letter in enumerate("KMGT", 1)}
_TIMES = {"s": 1, "min": 60, "h": 3600, "d": 86400, "w": 7 * 86400}
_UNITS = {"size": (_SIZES, "50GB"), "time": (_TIMES, "30d")}
_FORM = re.compile(r"(\d+(?:\.\d+)?)\s*([A-Za-z]+)")


def read(text: str, what: str) -> float:
    """Bytes in `50GB` or `1.5 GiB` if `what` is `size`; seconds in `30d` or `12h` if it is `time`.

    Raises:
        UsageError: `text` is not such an amount.
    """
    units, example = _UNITS[what]
    found = _FORM.fullmatch(text.strip())
    known = {unit.lower(): factor for unit, factor in units.items()}
    if found is None or found[2].lower() not in known:
        facts = {"units": listing(units)}
        raise UsageError(f"`{text}` is not a {what}", code="DXB-U150", facts=facts, hint=f"write it as `{example}`")
    return float(found[1]) * known[found[2].lower()]

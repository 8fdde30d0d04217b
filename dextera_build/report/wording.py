"""The words and marks that consoles and the report share: durations, counts, sizes, node states."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping

MARKS: Mapping[str, str] = {
    "cached": "=",
    "ran": "+",
    "fetched": "↓",
    "failed": "✗",
    "waits": "·",
    "cancelled": "-",
}
"""Status -> its sign without colour."""

STATES: Mapping[str, tuple[str, str]] = {
    "ran": ("ran", "ran"),
    "cached": ("cached", "cached"),
    "fetched": ("fetched", "fetched"),
    "failed": ("failed", "failed"),
    "waits": ("waits", "wait"),
    "cancelled": ("cancelled", "cancelled"),
}
"""Status -> its word for one node and for several, in the order of summaries."""

STUB = "stub"
"""Name of the backends whose results are right in type and shape, and mean nothing."""


def stubs(made: int, of: int) -> str:
    """How many results stub backends made; "" for none."""
    return f"stub backends made {made:,} of {count(of, 'result')}" if made else ""


_SMALLER = {"m": (1000, "mm"), "mm": (1000, "µm"), "kg": (1000, "g"), "s": (1000, "ms")}
"""Unit -> how many of the next smaller one it has, and that one."""
_POWERS = {"m2": "m²", "m3": "m³", "cm2": "cm²", "cm3": "cm³", "mm2": "mm²", "mm3": "mm³"}
_LEAST_PERCENT = 0.01


def duration(seconds: float) -> str:
    """Seconds as text: `0.31 s`, `34.2 s`, `1 min 10 s`, `21 min`, `2 h 05 min`."""
    if seconds < 0.995:
        return f"{max(seconds, 0.0):.2f} s"
    if seconds < 99.95:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    if whole < 600:
        return f"{whole // 60} min {whole % 60:02d} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"


def count(number: int, noun: str, several: str = "") -> str:
    """`1 node`, `1,204 nodes`; `several` is an irregular plural."""
    return f"{number:,} {noun if number == 1 else several or noun + 's'}"


def states(counts: Mapping[str, int]) -> str:
    """`9 ran, 9 cached, 1 fetched`: states that did not occur are left out."""
    found = [f"{counts[s]:,} {words[counts[s] != 1]}" for s, words in STATES.items() if counts.get(s)]
    return ", ".join(found)


def some(names: Iterable[str], most: int = 6) -> str:
    """Names in their order, shortened after `most`: `scene, usd and 12 more`."""
    known = list(names)
    if len(known) <= most:
        return ", ".join(known)
    return f"{', '.join(known[:most])} and {len(known) - most} more"


def size(octets: int) -> str:
    """Bytes in decimal units: `812 B`, `4.2 kB`, `1.3 MB`."""
    number = float(octets)
    for unit in ("B", "kB", "MB", "GB", "TB"):
        if number < 999.5 or unit == "TB":
            break
        number /= 1000
    return f"{number:.0f} {unit}" if unit == "B" or number >= 99.5 else f"{number:.1f} {unit}"


def moment(seconds: float | None) -> str:
    """The local date and time of seconds since the epoch: `2026-01-31 12:00:00`; `-` if unknown."""
    return "-" if seconds is None else time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(seconds))


def used(usage: Mapping[str, float]) -> str:
    """Resource usage: `3.1 s of processor, 812 MB of memory, 4.2 MB read, 1.3 MB written`; "" if unknown."""
    parts = [f"{duration(usage['cpu_seconds'])} of processor"] if "cpu_seconds" in usage else []
    names = {"memory_bytes": "of memory", "read_bytes": "read", "written_bytes": "written"}
    return ", ".join([*parts, *(f"{size(int(usage[name]))} {word}" for name, word in names.items() if name in usage)])


def number(value: float) -> str:
    """A measured number with four significant digits, without an exponent in the usual range."""
    if value == 0 or 1e-4 <= abs(value) < 1e6:
        if value == int(value):
            return f"{int(value):,}"
        digits = max(0, 3 - _magnitude(value))
        return f"{value:,.{digits}f}".rstrip("0").rstrip(".") if digits else f"{value:,.0f}"
    return f"{value:.3g}"


def quantity(value: float, unit: str) -> str:
    """A measured number with its unit, as people write it: `12.9 dB`, `0.45 mm`, `< 0.01 %`, `246 B`.

    Small lengths, masses and times take the next smaller unit, megabytes the one that fits, and percentages end at
    hundredths.
    """
    if unit == "MB":
        return size(round(1e6 * value))
    if unit.startswith("%"):
        return f"{percent(value)} {unit}"
    while unit in _SMALLER and 0 < abs(value) < 0.1:
        value, unit = value * _SMALLER[unit][0], _SMALLER[unit][1]
    return f"{number(value)} {_POWERS.get(unit, unit)}".rstrip()


def percent(value: float) -> str:
    """The number of a percentage, to hundredths; of one that would be 0 without being it, that it is less."""
    if 0 < abs(value) < _LEAST_PERCENT:
        return f"< {_LEAST_PERCENT}"
    return number(round(value, 2))


def _magnitude(value: float) -> int:
    power = 0
    size = abs(value)
    while size >= 10:
        size, power = size / 10, power + 1
    while 0 < size < 1:
        size, power = size * 10, power - 1
    return power


def parted(line: str) -> tuple[str, list[str]]:
    """The summary of a result and its warnings, from the one line that holds both; see `Outcome.told`."""
    said, *warnings = f"; {line}".split("; warning: ")
    return said.removeprefix("; "), warnings

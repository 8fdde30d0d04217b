"""A value as one line of text."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from dextera_build.artifacts.core.arrays import Array, is_array

if TYPE_CHECKING:
    import numpy as np

_LONGEST = 110
"""Maximum length of the facts in one line [characters]; further facts are left out."""
_MOST_NAMES = 6
"""Maximum number of labels listed; beyond it only their number is given."""
_DIGEST = re.compile("[0-9a-f]{64}")
_UNITS = {"m": "m", "kg": "kg", "rad": "rad", "deg": "deg", "s": "s", "hz": "Hz", "iou": "IoU"}


def line(name: str, facts: Iterator[str]) -> str:
    """`Mesh(1,204 vertices, 104 x 84 x 93 mm, 2,400 faces)`; facts that do not fit become `...`."""
    found = list(dict.fromkeys(facts))
    kept = 1
    while kept < len(found) and len(", ".join(found[: kept + 1])) <= _LONGEST:
        kept += 1
    return f"{name}({', '.join([*found[:kept], *(['...'] if kept < len(found) else [])])})"


def facts(fields: Mapping[str, Any], specs: Mapping[str, Array]) -> Iterator[str]:
    """Counts, sizes, extents and units of fields; empty fields are skipped.

    Args:
        fields: Name -> value.
        specs: Name -> declared form, for arrays.
    """
    rest = dict(fields)
    if isinstance(rest.get("width"), int) and isinstance(rest.get("height"), int):
        yield f"{rest.pop('width')} x {rest.pop('height')} px"
    for name, value in rest.items():
        if is_array(value):
            yield from _of_array(name, value, specs[name])
        elif value not in (None, False, "", b"", (), {}):
            yield from _of_plain(name.replace("_", " "), value)


def _of_array(name: str, value: np.ndarray, spec: Array) -> Iterator[str]:
    axes = spec.shape.split()
    if axes == ["4", "4"]:
        return  # sixteen numbers of a pose are unreadable in one line
    if axes[:2] == ["H", "W"]:
        yield f"{value.shape[1]} x {value.shape[0]} px"
        if spec.unit and (value > 0).any():
            there = value[value > 0]
            yield f"{name} {there.min():.2f} to {there.max():.2f} {spec.unit} on {len(there) / value.size:.0%}"
        return
    yield f"{len(value):,} {name}"
    if spec.unit == "m" and axes[-1] in ("2", "3") and len(value):
        yield " x ".join(f"{1000 * length:.0f}" for length in value.max(axis=0) - value.min(axis=0)) + " mm"


def _of_plain(words: str, value: Any) -> Iterator[str]:
    if value is True:
        yield words
    elif isinstance(value, bytes):
        yield f"{words} {size(len(value))}"
    elif isinstance(value, dict | tuple):
        if isinstance(value, dict) or not all(isinstance(part, float) for part in value):
            yield f"{_counted(len(value), words)}{_labels(getattr(part, 'name', part) for part in value)}"
    elif isinstance(value, int | float):
        bare, _, unit = words.rpartition(" ")
        number = f"{value:,}" if isinstance(value, int) else f"{value:.4g}"
        yield f"{bare} {number} {_UNITS[unit]}" if unit in _UNITS else f"{words} {number}"
    elif isinstance(value, str):
        shown = value[:12] if _DIGEST.fullmatch(value) else value
        yield f"{words} {shown if len(shown) < 40 and shown.isprintable() else ascii(shown[:36])}"
    elif hasattr(value, "facts"):
        yield from list(value.facts())[:2]
    elif isinstance(getattr(value, "name", None), str):
        yield f"{words} {value.name}"


def _counted(count: int, words: str) -> str:
    one = words.removesuffix("es") if words.endswith("xes") else words.removesuffix("s")
    return f"1 {one}" if count == 1 else f"{count:,} {words}"


def _labels(names: Iterator[object]) -> str:
    known = list(names)
    shown = ", ".join(name for name in known if isinstance(name, str))
    listed = len(known) <= _MOST_NAMES and all(isinstance(name, str) and name for name in known)
    return f" ({shown})" if listed and len(shown) < 80 and shown.isprintable() else ""


def size(count: int) -> str:
    """Bytes as text: `1.2 MB`."""
    for unit, factor in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= factor:
            return f"{count / factor:.1f} {unit}"
    return f"{count} bytes"

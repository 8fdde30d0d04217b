"""Rows for people and for programs: an aligned table with headers on a terminal, tab-separated cells elsewhere."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Mapping, Sequence
from typing import Any

from dextera_build.cli.errors import paint, wants_colour

_BETWEEN = "  "
HEADERS = {
    "last_seconds": "last run [s]",
    "seconds": "time [s]",
}
"""Column -> what stands above it, where that is more than its name."""


def give(rows: Any, *, as_json: bool, cells: Sequence[Mapping[str, str]] | None = None) -> int:
    """Print rows as JSON, or as a table, of `cells` where a person reads other texts; the exit code."""
    if as_json:
        print(json.dumps(rows, indent=1))
    else:
        show(rows if cells is None else cells)
    return 0


def show(rows: Sequence[Mapping[str, str]]) -> None:
    """Print rows, all with the same columns; the last column of a table is cut where the terminal ends."""
    if not rows:
        return
    if not sys.stdout.isatty():
        print("\n".join("\t".join(row.values()) for row in rows))
        return
    names = list(rows[0])
    cells = [[HEADERS.get(name, name.replace("_", " ")) for name in names], *(list(row.values()) for row in rows)]
    widths = [max(len(row[column]) for row in cells) for column in range(len(names))]
    right = [all(_is_number(row[column]) for row in cells[1:]) for column in range(len(names))]
    room = max(20, shutil.get_terminal_size().columns - 1)
    for number, row in enumerate(cells):
        aligned = [
            text.rjust(width) if is_right else text.ljust(width)
            for text, width, is_right in zip(row, widths, right, strict=True)
        ]
        line = _BETWEEN.join(aligned).rstrip()
        line = line if len(line) <= room else f"{line[: room - 1]}…"
        print(paint(line, "1", wants_colour(sys.stdout) and not number))


def _is_number(text: str) -> bool:
    return text == "-" or text.replace(".", "", 1).isdecimal()

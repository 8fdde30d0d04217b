"""Results for people and for programs: rows as a table, tab-separated or JSON; a text printed or written to a file."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from dextera_build.cli.errors import paint, wants_colour
from dextera_build.errors import UsageError
from dextera_build.project.project import Project

_BETWEEN = "  "
HEADERS = {
    "last_seconds": "last run [s]",
    "seconds": "time [s]",
}
"""Column -> its heading, if other than its name."""


def give(rows: Any, *, as_json: bool, cells: Sequence[Mapping[str, str]] | None = None) -> int:
    """Print rows as JSON, or `cells` (default: the rows) as a table; return the exit code."""
    if as_json:
        print(json.dumps(rows, indent=1))
    else:
        show(rows if cells is None else cells)
    return 0


def show(rows: Sequence[Mapping[str, str]]) -> None:
    """Print rows, all with the same columns; the last column of a table is cut at the width of the terminal."""
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


def give_text(project: Project, text: str, out: str | None) -> int:
    """Print `text`, or write it to `out` and print the path; return the exit code.

    Raises:
        UsageError: The file cannot be written.
    """
    if out is None:
        print(text)
        return 0
    path = Path(out)
    with writing(path):
        path.write_text(text + "\n", encoding="utf-8")
    print(project.shown(path.absolute()))
    return 0


@contextmanager
def writing(path: Path, hint: str | None = None) -> Iterator[None]:
    """Turn a system error while `path` is written into a `UsageError`.

    Raises:
        UsageError: The file cannot be written.
    """
    try:
        yield
    except OSError as error:
        raise UsageError(f"`{path}` cannot be written: {error.strerror}", code="DXB-U177", hint=hint) from None

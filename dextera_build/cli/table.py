"""Results for people and for programs: rows as a table, tab-separated or JSON; a text printed or written to a file."""

from __future__ import annotations

import io
import json
import math
import shutil
import sys
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import Any

from dextera_build.cli.errors import paint, wants_colour
from dextera_build.errors import StoreError, UsageError
from dextera_build.project.project import Project

_BETWEEN = "  "
_INDENT = "    "
_LEAST = 24
"""Text that wraps in a column is not narrower than this [characters]."""
_SHORT = 12
"""Text of a narrow table that is not broken [characters]."""
HEADERS = {
    "last_seconds": "last run [s]",
    "seconds": "time [s]",
}
"""Column -> its heading, if other than its name."""


def give(
    document: str,
    content: Sequence[Mapping[str, Any]] | Mapping[str, Any],
    *,
    as_json: bool,
    cells: Sequence[Mapping[str, Any]] | None = None,
    narrow: Sequence[Mapping[str, str]] | None = None,
    none: str = "",
) -> int:
    """Print a document of `cli.documents` as JSON, or a table; return the exit code.

    Args:
        document: Its name.
        content: Its rows, or its fields.
        as_json: Whether to print JSON.
        cells: Rows of the table; default: `content`.
        narrow: See `show`.
        none: What standard error gets in place of a table without rows.
    """
    if none and not content and not as_json:
        print(none, file=sys.stderr)
    elif as_json:
        print(spelled(document, content, indent=1))
    elif cells is not None:
        show(cells, narrow)
    else:
        show([content] if isinstance(content, Mapping) else content, narrow)
    return 0


def say(document: str, content: Mapping[str, Any], text: str, *, as_json: bool) -> None:
    """Print a document as one line of JSON, or `text`, at once: a program may wait for it."""
    print(spelled(document, content) if as_json else text, flush=True)


def spelled(
    document: str, content: Sequence[Mapping[str, Any]] | Mapping[str, Any], *, indent: int | None = None
) -> str:
    """A document as JSON, its schema first."""
    from dextera_build.cli.documents import DOCUMENTS

    fields = content if isinstance(content, Mapping) else {"rows": content}
    told = {"schema": DOCUMENTS[document].schema, **fields}
    try:
        return json.dumps(told, indent=indent, allow_nan=False)
    except ValueError:
        return json.dumps(_finite(told), indent=indent, allow_nan=False)


def _finite(value: Any) -> Any:
    """The same with null for numbers that JSON does not have: infinities, and what is not a number."""
    if isinstance(value, Mapping):
        return {name: _finite(inner) for name, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def show(rows: Sequence[Mapping[str, Any]], narrow: Sequence[Mapping[str, str]] | None = None) -> None:
    """Print rows, all with the same columns.

    Args:
        rows: The rows; a pipe gets their cells, separated by tabs. Numbers have one decimal, None is `-`.
        narrow: The same in fewer columns, for a terminal that is too narrow for `rows`; text that is still too long
            wraps within its column.
    """
    if not rows:
        return
    rows = [{name: _text(value) for name, value in row.items()} for row in rows]
    if not sys.stdout.isatty():
        print("\n".join("\t".join(row.values()) for row in rows))
        return
    room = max(20, shutil.get_terminal_size().columns - 1)
    if _width(rows) <= room:
        _aligned(rows)
    elif _may_wrap(narrow or rows, room):
        _wrapped(narrow or rows, room)
    else:
        _stacked(rows, room)


def _text(value: Any) -> str:
    return "-" if value is None else f"{value:.1f}" if isinstance(value, float) else str(value)


def _heading(name: str) -> str:
    return HEADERS.get(name, name.replace("_", " "))


def _width(rows: Sequence[Mapping[str, str]]) -> int:
    """Width of a table whose cells do not wrap [characters]."""
    widths = [max(len(_heading(name)), *(len(row[name]) for row in rows)) for name in rows[0]]
    return sum(widths) + len(_BETWEEN) * (len(widths) - 1)


def _may_wrap(rows: Sequence[Mapping[str, str]], room: int) -> bool:
    """Whether every long column would be wide enough to read."""
    widths = [max(len(_heading(name)), *(len(row[name]) for row in rows)) for name in rows[0]]
    long = [width for width in widths if width > _SHORT]
    free = room - sum(widths) + sum(long) - len(_BETWEEN) * (len(widths) - 1)
    return all(free // len(long) >= min(width, _LEAST) for width in long)


def _stacked(rows: Sequence[Mapping[str, str]], room: int) -> None:
    """Print the first columns that fit, and the others of each row below them with their headings."""
    names, first = list(rows[0]), list[str]()
    for name in names:
        if first and _width([{each: row[each] for each in [*first, name]} for row in rows]) > room:
            break
        first.append(name)
    head = io.StringIO()
    with redirect_stdout(head):
        _aligned([{name: row[name] for name in first} for row in rows])
    lines = head.getvalue().splitlines()
    print(paint(lines[0], "1", wants_colour(sys.stdout)))
    for line, row in zip(lines[1:], rows, strict=True):
        print(line)
        rest = [f"{_heading(name)}: {row[name]}" for name in names if name not in first and row[name] not in ("", "-")]
        for below in textwrap.wrap("; ".join(rest), room - len(_INDENT)):
            print(f"{_INDENT}{below}")


def _aligned(rows: Sequence[Mapping[str, str]]) -> None:
    cells = [[*map(_heading, rows[0])], *(list(row.values()) for row in rows)]
    columns = list(zip(*cells, strict=True))
    widths = [max(map(len, column)) for column in columns]
    right = [all(map(_is_number, column[1:])) for column in columns]
    for number, row in enumerate(cells):
        aligned = [
            text.rjust(width) if is_right else text.ljust(width)
            for text, width, is_right in zip(row, widths, right, strict=True)
        ]
        print(paint(_BETWEEN.join(aligned).rstrip(), "1", wants_colour(sys.stdout) and not number))


def _wrapped(rows: Sequence[Mapping[str, str]], room: int) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    made = Table(box=None, pad_edge=False, padding=(0, len(_BETWEEN), 0, 0), header_style="bold")
    for name in rows[0]:
        column = [row[name] for row in rows]
        width = max(map(len, column))
        # Numbers and short words are not broken, nor the names in the first column if they leave room for the rest.
        whole = width <= _SHORT or (name == next(iter(rows[0])) and width <= room // 2)
        numbers = all(map(_is_number, column))
        made.add_column(_heading(name), justify="right" if numbers else "left", overflow="fold", no_wrap=whole)
    for row in rows:
        made.add_row(*map(Text, row.values()))
    console = Console(file=io.StringIO(), width=room, force_terminal=wants_colour(sys.stdout), highlight=False)
    console.print(made)
    print("\n".join(line.rstrip() for line in console.file.getvalue().splitlines()))  # type: ignore[attr-defined]


def _is_number(text: str) -> bool:
    return text == "-" or text.replace(".", "", 1).isdecimal()


def give_text(project: Project, text: str, out: str | None, *, as_json: bool = False) -> int:
    """Print `text`, or write it to `out` and print the path, with `as_json` as a document; return the exit code.

    Raises:
        UsageError: The file cannot be written.
    """
    if out is None:
        print(text)
        return 0
    path = Path(out)
    with writing(path):
        path.write_text(text + "\n", encoding="utf-8")
    file = project.shown(path.absolute())
    say("show.file", {"file": file}, file, as_json=as_json)
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
    except StoreError as error:
        if error.code != "DXB-S102":
            raise
        # Files outside the store are written by the same functions.
        why = error.facts["system says"]
        raise UsageError(f"`{path}` cannot be written: {why}", code="DXB-U177", hint=hint) from None

"""Pieces of Markdown that the references are put together from."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table without its empty columns, or nothing where there are no rows."""
    cells = [[cell(text) for text in row] for row in rows]
    if not cells:
        return ""
    kept = [column for column in range(len(heads)) if any(row[column] for row in cells)]
    heads = [heads[column] for column in kept]
    lines = [f"| {' | '.join(row[column] for column in kept)} |" for row in cells]
    return "\n".join([f"| {' | '.join(heads)} |", f"|{' --- |' * len(heads)}", *lines]) + "\n"


def cell(text: str) -> str:
    """Text as one table cell: one line, bars escaped."""
    return " ".join(text.split()).replace("|", "\\|")


def escaped(text: str) -> str:
    """Text that is not Markdown, as Markdown; text in backticks stays a literal."""
    parts = text.split("`")
    parts[::2] = [re.sub(r"([_*<>\[\]$])", r"\\\1", part) for part in parts[::2]]
    return "`".join(parts)


def code(text: object) -> str:
    """A literal; empty text stays empty."""
    return f"`{text}`" if str(text) else ""


def join(*parts: str) -> str:
    """Parts with a blank line between them; empty ones are left out."""
    return "\n\n".join(part.strip("\n") for part in parts if part.strip()) + "\n"

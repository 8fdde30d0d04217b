"""Errors as text for a terminal: message, place, facts, and a hint."""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TextIO

from dextera_build.errors import DxbError, Place
from dextera_build.redact import redact_plain
from dextera_build.report.wording import some
from dextera_build.runs.events import NodeFinished

_RED, _CYAN, _DIM, _BOLD = "31;1", "36", "2", "1"
_WORD = re.compile(r"\"[^\"]*\"|'[^']*'|[^\s,{}\[\]]+")
_UNSEEN = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200b-\u200f\u2028-\u202e\u2060-\u206f\ud800-\udfff\ufeff]")
"""Control characters, and characters that change the direction of text."""
_LONGEST = 1000
"""Longest message, hint or place [characters]; untrusted files can make them arbitrarily long."""
_LONGEST_FACT = 8000
_LONGEST_LINE = 300


def read_lines(file: str) -> list[str] | None:
    """Lines of a text file, or None if it cannot be read."""
    try:
        return Path(file).read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError, ValueError):
        return None


def wants_colour(stream: TextIO) -> bool:
    """Whether `stream` is a terminal and colour is not disabled (https://no-color.org)."""
    return stream.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


def paint(text: str, style: str, colour: bool) -> str:
    """`text` in an ANSI style (`31;1`), or unchanged without `colour`."""
    return f"\x1b[{style}m{text}\x1b[0m" if colour and text else text


def render(error: DxbError, *, colour: bool = False) -> str:
    """An error as text without a final newline.

    Args:
        error: The error.
        colour: Use ANSI colours.
    """
    head = f"{paint(f'error[{error.code}]', _RED, colour)}: {paint(_clean(error.message), _BOLD, colour)}"
    body = _quoted(error, error.where, colour) if error.where else _aligned([*error.facts.items()], colour)
    return "\n".join([head, *body, *_hint(error, colour)])


def render_node(node: NodeFinished, waiting: Sequence[str], run: str, *, colour: bool = False) -> str:
    """A failed node as text without a final newline.

    Args:
        node: Event of the failed node.
        waiting: Addresses of the nodes that never ran because of it.
        run: The run's name, for `dxb log`.
        colour: Use ANSI colours.
    """
    error = node.error or DxbError("it ended without a result")
    verb = "failed its check" if error.code == "DXB-B201" else "failed"
    backend = f", backend {node.backend}" if node.backend else ""
    facts = {"rule": f"{node.rule}{backend}"} | ({"at": str(error.where)} if error.where else {}) | error.facts
    facts |= {"waits": some(waiting)} if waiting else {}
    facts["log"] = f"dxb log {shlex.quote(run)} {shlex.quote(node.node)}"
    told = DxbError(f"{node.node} {verb}: {error.message}", code=error.code, facts=facts, hint=error.hint)
    return render(told, colour=colour)


def _aligned(rows: list[tuple[str, str]], colour: bool) -> list[str]:
    width = max((len(name) for name, _ in rows), default=0)
    indent = " " * (width + 6)
    return [
        f"   {paint(_clean(name.ljust(width)), _DIM, colour)}   {_indented(value, indent)}".rstrip()
        for name, value in rows
    ]


def _quoted(error: DxbError, where: Place, colour: bool) -> list[str]:
    gutter = " " * max(len(str(where.line)), 2)
    out = [f"{gutter}{paint('-->', _CYAN, colour)} {_clean(str(where))}"]
    text = _line(where)
    if text is not None:
        text, column = _window(text, where.column)
        bar = paint("|", _CYAN, colour)
        out += [f"{gutter} {bar}", f"{paint(str(where.line).rjust(len(gutter)), _CYAN, colour)} {bar} {text}".rstrip()]
        if column:
            # Tabs are kept in the padding, which aligns the marks with the word at any tab width.
            blank = re.sub(r"[^\t]", " ", text[: column - 1])
            marks = "^" * _length(text, column, error.message)
            out.append(f"{gutter} {bar} {blank}{paint(marks, _RED, colour)}")
    equals = paint("=", _CYAN, colour)
    indent = gutter + "   "
    return out + [
        f"{gutter} {equals} {_clean(name)}: {_indented(value, indent)}" for name, value in error.facts.items()
    ]


def _window(text: str, column: int) -> tuple[str, int]:
    """The part of a line around a column, and the column within it; every character becomes one cell wide."""
    start = max(column - _LONGEST_LINE // 2, 0) if len(text) > _LONGEST_LINE else 0
    return _UNSEEN.sub("\ufffd", text[start : start + _LONGEST_LINE]), max(column - start, 0)


def _clean(text: str, longest: int = _LONGEST) -> str:
    """`text` with control characters escaped, shortened to about `longest` characters."""
    if len(text) > longest:
        text = f"{text[: longest // 2]} ... {text[-longest // 2 :]}"
    return _UNSEEN.sub(lambda found: found.group().encode("unicode_escape").decode(), text)


def _line(where: Place) -> str | None:
    """The source line; None if the file cannot be read."""
    found: list[str] | None = redact_plain(read_lines(where.file)) if where.line else None
    if not found or where.line > len(found):
        return None
    return found[where.line - 1]


def _length(text: str, column: int, message: str) -> int:
    """Number of characters to underline: a literal of the message if one starts at the column, else the word."""
    rest = text[column - 1 :]
    literals = sorted(re.findall(r"`([^`]+)`", message), key=len, reverse=True)
    for literal in literals:
        if rest.startswith(literal):
            return len(literal)
    word = _WORD.match(rest)
    return len(word.group().rstrip(":")) or 1 if word else 1


def _indented(value: str, indent: str) -> str:
    return _clean(value, _LONGEST_FACT).replace("\n", "\n" + indent)


def _hint(error: DxbError, colour: bool) -> list[str]:
    return ["", f"{paint('hint', _CYAN, colour)}: {_clean(error.hint)}"] if error.hint else []

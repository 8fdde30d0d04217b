"""A value as HTML, for notebooks."""

from __future__ import annotations

import base64
from html import escape

from dextera_build.artifacts.table import Table


def of_table(table: Table, said: str) -> str:
    """A table below its line of text."""
    headings = [column.heading for column in table.columns]
    rows = [[table.text(cell, column) for cell, column in zip(row, table.columns, strict=True)] for row in table.rows]
    return page(said, None, _rows(headings, rows))


def page(said: str, picture: bytes | None, more: str = "") -> str:
    """HTML for a notebook.

    Args:
        said: The value as one line of text.
        picture: PNG bytes, or None.
        more: HTML to add below.
    """
    shown = ""
    if picture is not None:
        uri = base64.b64encode(picture).decode()
        shown = f'<br><img alt="" style="max-width:480px" src="data:image/png;base64,{uri}">'
    return f"<div><code>{escape(said)}</code>{shown}{more}</div>"


def _rows(headings: list[str], rows: list[list[str]]) -> str:
    """An HTML table of texts."""
    head = "".join(f"<th>{escape(text)}</th>" for text in headings)
    body = "".join("<tr>" + "".join(f"<td>{escape(text)}</td>" for text in row) + "</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"

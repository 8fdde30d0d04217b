"""Puts the tables into a docs page."""

from __future__ import annotations

from pathlib import Path

BEGIN, END = "% engine: begin", "% engine: end"


def insert(page: Path, text: str) -> None:
    """Replace what stands between the two marks."""
    old = page.read_text()
    before, begin, rest = old.partition(BEGIN + "\n")
    _, end, after = rest.partition(END + "\n")
    if not begin or not end:
        raise SystemExit(f"`{page}` has no lines `{BEGIN}` and `{END}`")
    page.write_text(f"{before}{begin}\n{text}\n{end}{after}")

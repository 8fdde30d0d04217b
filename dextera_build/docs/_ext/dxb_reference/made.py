"""Pages that are made at build time, in the copy of the docs that is built."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path


def write(folder: Path, pages: Mapping[str, str]) -> None:
    """Make `folder` hold these pages and no other; equal files stay, so they are not read again.

    Args:
        folder: Below the docs.
        pages: Name of a file without its ending -> Markdown.
    """
    folder.mkdir(exist_ok=True)
    for old in folder.glob("*.md"):
        if old.stem not in pages:
            old.unlink()
    for name, text in pages.items():
        file = folder / f"{name}.md"
        if not file.is_file() or file.read_text(encoding="utf-8") != text:
            file.write_text(text, encoding="utf-8")

"""Sphinx extension: references that are made from the code at build time.

Pages that hold `% generated: NAME` get that reference; every rule and every example gets a page of its own, which is
written next to the others: build from a copy, as `make docs` does.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from . import artifacts, cli, documents, errors, examples, gallery, made, rules, states, terms

if TYPE_CHECKING:
    from sphinx.application import Sphinx

MAKERS: dict[str, Callable[[], str]] = {
    "actions": terms.actions_page,
    "artifacts": artifacts.page,
    "cli": cli.page,
    "documents": documents.page,
    "errors": errors.page,
    "events": documents.events_page,
    "gallery": gallery.page,
    "rules": rules.page,
    "states": states.page,
    "terms": terms.page,
    "variables": cli.variables_page,
}
_MARK = "% generated: "


def fill(text: str) -> str:
    """`text` with every marker line replaced by the reference that it names.

    Raises:
        KeyError: A marker names no reference.
    """
    lines = text.split("\n")
    return "\n".join(MAKERS[line.removeprefix(_MARK).strip()]() if line.startswith(_MARK) else line for line in lines)


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect to Sphinx."""

    def write(app: Sphinx) -> None:
        docs = Path(app.srcdir)
        made.write(docs / rules.FOLDER, rules.pages())
        made.write(docs / examples.FOLDER, examples.pages())

    def read(app: Sphinx, page: str, source: list[str]) -> None:
        source[0] = examples.linked(fill(source[0]), page)
        if _MARK in source[0]:
            raise ValueError(f"{page}: a marker was not filled in")

    app.connect("builder-inited", write)
    app.connect("source-read", read)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

"""The page in which the result can be turned: in the report, started by a button, or beside it, if it is large."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from dextera_build.report.document import write
from dextera_build.report.html import Html, join, tag

MOST_BYTES = 5_000_000
"""Larger pages stand beside the report."""


@dataclass(frozen=True)
class View:
    """The page of `dxb view --save`; one of the two is empty, or both without a page."""

    page: str = ""
    """Its text, which stands in the report."""
    link: str = ""
    """To the page beside the report."""

    def __bool__(self) -> bool:
        return bool(self.page or self.link)


NOTHING = View()


def placed(page: str, out: Path) -> View:
    """A page for the report `out`: in it, or written beside it if it is large."""
    if len(page.encode()) <= MOST_BYTES:
        return View(page=page)
    beside = out.with_name(f"{out.stem}_3d.html")
    write(beside, page)
    return View(link=beside.name)


def closer(view: View) -> Html | None:
    """What leads from the picture to the page, and the place for the page; nothing without one."""
    if view.link:
        return tag("p", {"class": "closer"}, tag("a", {"href": view.link}, "Open it in 3D"))
    if not view.page:
        return None
    # Without scripts there is no page: the script shows the buttons.
    buttons = [
        tag(
            "button",
            {"type": "button", "id": "turn", "aria-expanded": "false", "aria-controls": "turned"},
            "Turn it in 3D",
        ),
        tag("button", {"type": "button", "id": "fill", "hidden": True}, "Full screen"),
    ]
    line = tag("p", {"class": "closer", "hidden": True}, buttons)
    return join([line, tag("div", {"id": "turned", "hidden": True})])


def held(view: View) -> Html | None:
    """The text of the page as data, which the browser neither runs nor shows before the button is pressed."""
    if not view.page:
        return None
    # `</script` would end the element, and `<!--` with `<script` would not let it end.
    text = json.dumps(view.page, ensure_ascii=False).replace("</", "<\\/").replace("<!", "\\u003c!")
    return tag("script", {"type": "application/json", "id": "view"}, Html(text.replace("<script", "\\u003cscript")))

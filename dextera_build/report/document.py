"""The frame of every page: one HTML document that loads nothing, with the style of the reports."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from dextera_build.report.html import Child, Html, tag

_POLICY = "default-src 'none'; img-src data:; media-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'"
_PLAYER = (
    "default-src 'none'; img-src data: blob:; media-src data:; font-src data:; style-src 'unsafe-inline'; "
    "script-src 'unsafe-inline' 'unsafe-eval' blob:; worker-src blob:; connect-src data: blob:"
)
"""For a page that holds one of the viewer, whose frame has no policy of its own: the player compiles WebAssembly,
evaluates its glue (Emscripten's embind), and starts workers, all of it out of the file."""


def document(
    title: str,
    *body: Child,
    styles: tuple[str, ...] = ("report.css",),
    script: str = "report.js",
    plays: bool = False,
) -> str:
    """The whole document.

    Args:
        title: Of the window.
        body: Its content.
        styles: Names of style sheets in `assets/`.
        script: Name of a script in `assets/`.
        plays: Whether the page holds one of the viewer.
    """
    head = tag(
        "head",
        None,
        tag("meta", {"charset": "utf-8"}),
        tag("meta", {"http-equiv": "Content-Security-Policy", "content": _PLAYER if plays else _POLICY}),
        tag("meta", {"name": "viewport", "content": "width=device-width, initial-scale=1"}),
        tag("meta", {"name": "color-scheme", "content": "light dark"}),
        tag("title", None, title),
        tag("style", None, Html("\n".join(_asset(name) for name in styles))),
    )
    content = tag("body", None, *body, tag("script", None, Html(_asset(script))))
    return "<!doctype html>\n" + tag("html", {"lang": "en"}, head, content)


def write(path: Path, text: str) -> None:
    """Write a document to `path` atomically."""
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".{path.name}.part")
    draft.write_text(text, encoding="utf-8")
    draft.replace(path)


def _asset(name: str) -> str:
    return (resources.files(__package__) / f"assets/{name}").read_text(encoding="utf-8")

"""The frame of every page: one HTML document that loads nothing, with the style of the reports."""

from __future__ import annotations

from importlib import resources

from dextera_build.report.html import Child, Html, tag

_POLICY = "default-src 'none'; img-src data:; media-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'"


def document(title: str, *body: Child, styles: tuple[str, ...] = ("report.css",), script: str = "report.js") -> str:
    """The whole document.

    Args:
        title: Of the window.
        body: Its content.
        styles: Names of style sheets in `assets/`.
        script: Name of a script in `assets/`.
    """
    head = tag(
        "head",
        None,
        tag("meta", {"charset": "utf-8"}),
        tag("meta", {"http-equiv": "Content-Security-Policy", "content": _POLICY}),
        tag("meta", {"name": "viewport", "content": "width=device-width, initial-scale=1"}),
        tag("meta", {"name": "color-scheme", "content": "light dark"}),
        tag("title", None, title),
        tag("style", None, Html("\n".join(_asset(name) for name in styles))),
    )
    content = tag("body", None, *body, tag("script", None, Html(_asset(script))))
    return "<!doctype html>\n" + tag("html", {"lang": "en"}, head, content)


def _asset(name: str) -> str:
    return (resources.files(__package__) / f"assets/{name}").read_text(encoding="utf-8")

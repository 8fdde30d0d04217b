"""`build`: makes one self-contained HTML file from an event log and the store."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from dextera_build import digest
from dextera_build.recipe.expect import Expectation
from dextera_build.report import bounds, figures, flow, objects, provenance, result, tasks, timeline
from dextera_build.report.compared import compared
from dextera_build.report.details import details
from dextera_build.report.document import document, write
from dextera_build.report.films import Films
from dextera_build.report.fitting import fitted
from dextera_build.report.html import Html, join, tag
from dextera_build.report.pictures import Pictures, Told, from_header
from dextera_build.report.pieces import section
from dextera_build.report.run import Run, read
from dextera_build.report.sources import Store
from dextera_build.report.tables import tables
from dextera_build.report.view import NOTHING, View, closer
from dextera_build.report.view import held as held_page
from dextera_build.runs.events import Event

LIMIT = 5_000_000
"""Maximum size of a report without its page in 3D [bytes]; pictures are made coarser until it fits."""


def build(
    events: Iterable[Event | Mapping[str, Any]],
    store: Store,
    out: Path,
    *,
    licences: Mapping[str, str] | None = None,
    expected: Mapping[str, Expectation] | None = None,
    view: View = NOTHING,
    against: Iterable[Event | Mapping[str, Any]] | None = None,
    told: Told | None = None,
) -> Path:
    """Write the report of a run to `out` atomically, and return `out`.

    Args:
        events: The run's events, as objects or as read from `events.jsonl`.
        store: The store of results, previews and headers.
        out: The HTML file.
        licences: `rule:backend` or distribution -> licence, if known to the caller.
        expected: The bounds that the recipe states.
        view: The page that shows the result in 3D.
        against: Events of a run to compare with.
        told: Hears how many pictures are compressed, of how many.
    """
    run = read(events, store)
    extra = _adopt_images(run, store)
    before = None if against is None else read(against, store)
    if before is not None:
        extra = _adopt_images(before, extra)
    held = bounds.table(run, expected or {})

    def draw(pictures: Pictures, films: Films | None) -> str:
        return page(run, pictures, licences or {}, films, held, view=view, before=before)

    limit = LIMIT + len((held_page(view) or "").encode())
    text = fitted(draw, extra, Films(store), limit, told)
    write(out, text)
    return out


def page(
    run: Run,
    pictures: Pictures,
    licences: Mapping[str, str],
    films: Films | None = None,
    held: Html | None = None,
    *,
    view: View = NOTHING,
    before: Run | None = None,
) -> str:
    """The whole document; without `films`, there are pictures instead; `held` is the table of bounds."""
    pictures.begin()
    image, shown = result.hero(run, pictures)
    shown_first = tag("div", None, closer(view), image) if image or view else None
    panels, held_by_figures = figures.figures(run, pictures)
    strip = result.strip(run, pictures, {shown, *held_by_figures})
    numbers, gallery = tables(run), tasks.cards(run, pictures, films)
    parts: list[tuple[str, str, list[Html | None]]] = [
        ("result", "Result", [tag("div", {"class": "result"}, shown_first, result.outcome(run)), strip]),
        (
            "compared",
            f"Beside run {before.name}" if before else "",
            [*compared(run, before, pictures)] if before else [],
        ),
        ("bounds", "Bounds", [held] if held else []),
        ("figures", "Figures", _cards(panels)),
        ("tasks", "Tasks", [tag("div", {"class": "gallery"}, gallery)] if gallery else []),
        ("objects", "Objects", _cards(objects.cards(run, pictures, objects=True))),
        ("numbers", "Numbers", [*numbers]),
        ("groups", "Groups", _cards(objects.cards(run, pictures, objects=False))),
        ("graph", "Graph", [flow.graph(run)]),
        ("timeline", "Timeline", [timeline.timeline(run)]),
        ("nodes", "Nodes", [details(run, pictures, films)]),
        ("provenance", "Provenance", [tag("div", {"class": "cards"}, provenance.provenance(run, licences))]),
        ("reproduce", "Make it again", [provenance.reproduce(run)]),
    ]
    parts = [part for part in parts if part[2]]
    menu = tag("nav", {"aria-label": "sections"}, [tag("a", {"href": f"#{name}"}, words) for name, words, _ in parts])
    sections = [section(name, words, *inner) for name, words, inner in parts]
    body = tag("main", None, result.title(run), menu, result.failures(run), sections)
    return document(f"{run.recipe} · run {run.name}", body, _overlays(), held_page(view), plays=bool(view.page))


def _cards(cards: list[Html]) -> list[Html | None]:
    return [tag("div", {"class": "cards"}, cards)] if cards else []


def _overlays() -> Html:
    close = tag("button", {"type": "button", "class": "close", "aria-label": "close"}, "×")
    panel = tag("aside", {"id": "panel", "hidden": True, "tabindex": "-1", "aria-label": "node"}, close, tag("div"))
    shut = tag("button", {"type": "button", "class": "close", "aria-label": "close"}, "×")
    large = tag("dialog", {"id": "large", "aria-label": "picture"}, shut, tag("figure"))
    return join([panel, large])


class _More:
    """A store with a few more blobs in memory."""

    def __init__(self, store: Store, blobs: dict[str, bytes]) -> None:
        self._store = store
        self._extra = blobs
        self.actions = store.actions
        self.blobs = self

    def get(self, name: str, /) -> bytes:
        """Bytes by digest."""
        return self._extra[name] if name in self._extra else self._store.blobs.get(name)


def _adopt_images(run: Run, store: Store) -> Store:
    """Give `Image` results without a preview one made from their pixels."""
    blobs: dict[str, bytes] = {}
    for i, node in enumerate(run.nodes):
        pixels = None if node.previews else from_header(store, node.artifact, node.fields)
        if pixels is not None:
            name = digest.of_bytes(pixels)
            blobs[name] = pixels
            run.nodes[i] = replace(node, previews=[(node.line, name)])
    return _More(store, blobs)

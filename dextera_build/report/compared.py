"""Two runs side by side: what each made of the nodes whose results differ, as pictures and as numbers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeAlias

from dextera_build.report.html import Html, tag
from dextera_build.report.layout import topological
from dextera_build.report.objects import foremost
from dextera_build.report.pictures import Pictures
from dextera_build.report.pieces import link
from dextera_build.report.result import hero
from dextera_build.report.run import Node, Run
from dextera_build.report.wording import count, quantity, some

_MOST = 60  # nodes with a card; the others are named

_Pair: TypeAlias = tuple[Node, Node]


def compared(run: Run, before: Run, pictures: Pictures) -> list[Html]:
    """A summary, the pictures at the top of both runs, and a card per node whose result differs.

    Args:
        run: The run that the page is about.
        before: The run that it is compared with.
        pictures: Pictures of the store.
    """
    then, now = before.by_address(), run.by_address()
    both = [(then[node.address], node) for node in topological(run.nodes) if node.address in then]
    changed = [pair for pair in both if pair[0].output != pair[1].output]
    told = [card for card in (_card(*pair, before, run, pictures) for pair in changed[:_MOST]) if card]
    tops = [hero(each, pictures)[0] or Html("") for each in (before, run)]
    first = [_sides(before, run, *tops)] if any(tops) else []
    return [tag("p", None, _summary(changed, both, then.keys() - now.keys(), now.keys() - then.keys())), *first, *told]


def _summary(changed: list[_Pair], both: list[_Pair], gone: set[str], new: set[str]) -> str:
    parts = [f"{len(changed)} of {count(len(both), 'node')} gave another result"]
    parts += [f"{some(sorted(gone))}: only then"] if gone else []
    parts += [f"{some(sorted(new))}: only now"] if new else []
    left = len(changed) - _MOST
    return "; ".join([*parts, *([f"{left} more are not shown"] if left > 0 else [])])


def _card(then: Node, now: Node, before: Run, run: Run, pictures: Pictures) -> Html | None:
    """Pictures and numbers of one node in both runs; nothing if it has neither."""
    figures = [_figure(node, pictures) for node in (then, now)]
    numbers = list(_numbers(then, now))
    if not any(figures) and not numbers:
        return None
    head = [tag("th", {"scope": "col", "class": kind}, words) for kind, words in _heads(before, run)]
    table = tag("table", None, tag("thead", None, tag("tr", None, head)), tag("tbody", None, numbers))
    return tag(
        "article",
        {"class": "card"},
        tag("h3", None, link(now), " ", tag("span", {"class": "sub"}, now.rule)),
        _sides(before, run, *figures) if any(figures) else None,
        tag("div", {"class": "scroll", "tabindex": "0"}, table) if numbers else None,
    )


def _heads(before: Run, run: Run) -> list[tuple[str, str]]:
    return [("", ""), ("number", f"run {before.name}"), ("number", f"run {run.name}")]


def _figure(node: Node, pictures: Pictures) -> Html:
    if not node.previews:
        return Html("")
    caption, digest = foremost(node)
    return pictures.figure(digest, caption, name=node.address)


def _sides(before: Run, run: Run, then: Html, now: Html) -> Html:
    sides = [
        tag("div", None, tag("h4", None, f"run {each.name}"), figure or tag("p", {"class": "quiet"}, "no picture"))
        for each, figure in ((before, then), (run, now))
    ]
    return tag("div", {"class": "sides"}, sides)


def _numbers(then: Node, now: Node) -> Iterator[Html]:
    """A row per number of either run, those that differ in bold."""
    for name in {**then.metrics, **now.metrics}:
        texts = [quantity(*node.metrics[name]) if name in node.metrics else "–" for node in (then, now)]
        cells = [tag("td", {"class": "number"}, text) for text in texts]
        words = name.replace("_", " ")
        yield tag(
            "tr", None, tag("th", {"scope": "row"}, words if texts[0] == texts[1] else tag("b", None, words)), cells
        )

"""The bounds that the recipe states for its metrics, compared with the run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from dextera_build.errors import RecipeError
from dextera_build.recipe.expect import STAND_INS, Expectation, Verdict, judge
from dextera_build.report.html import Html, tag
from dextera_build.report.run import Run
from dextera_build.report.wording import quantity

_COLUMNS = ("metric", "value", "interval", "bound", "verdict")


def table(run: Run, expected: Mapping[str, Expectation]) -> Html | None:
    """One row per bound and node; None without bounds, or if the run's results are stand-ins."""
    if not expected or run.profile == STAND_INS:
        return None
    rows = [tag("tr", None, cells) for each in expected.values() for cells in _rows(run, each)]
    head = tag("thead", None, tag("tr", None, [tag("th", {"scope": "col"}, name) for name in _COLUMNS]))
    whole = tag("table", None, head, tag("tbody", None, rows))
    return tag("div", {"class": "card"}, tag("div", {"class": "scroll", "tabindex": "0"}, whole))


def _rows(run: Run, each: Expectation) -> Iterator[list[Html]]:
    metrics = {node.address: node.metrics if node.output else None for node in run.nodes}
    try:
        for verdict in judge({each.name: each}, metrics):
            yield _cells(run, verdict)
    except RecipeError as error:  # the recipe may have changed since, and the run may be of a part of it
        yield [
            tag("td", None, each.name),
            tag("td", {"colspan": 2}, error.message),
            tag("td", None, each.bound),
            _mark(None),
        ]


def _cells(run: Run, each: Verdict) -> list[Html]:
    index = run.by_address()[each.node].index
    name = tag("a", {"href": f"#n{index}", "data-node": index}, f"{each.node}.{each.metric}")
    value = "–" if each.value is None else quantity(each.value, each.unit)
    between = " to ".join(quantity(edge, each.unit) for edge in each.interval) if each.interval else "–"
    cells = [tag("td", None, text) for text in (name, value, between, each.expected.bound)]
    return [*cells, _mark(None if each.value is None else each.ok)]


def _mark(ok: bool | None) -> Html:
    if ok is None:
        return tag("td", None, "not built")
    return tag("td", {"class": "yes" if ok else "no"}, "✓ holds" if ok else "✗ missed")

"""The bounds of a recipe, compared with its results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from dextera_build.errors import RuleError, StaleError
from dextera_build.recipe.expect import Verdict, judge
from dextera_build.report.wording import count

if TYPE_CHECKING:
    from dextera_build.engine.graph import Graph
    from dextera_build.recipe.expect import Metrics
    from dextera_build.recipe.schema import Recipe
    from dextera_build.session import Session


def verdicts(session: Session, recipe: Recipe, graph: Graph) -> list[Verdict]:
    """Every bound of a recipe, compared with the present results of the nodes that it names; nothing runs.

    Raises:
        RecipeError: There is no such node, copy or metric.
    """
    from dextera_build.engine.dry import plan as dry
    from dextera_build.engine.graph import Address

    calls = {call for call, _ in graph.calls()}
    wanted = dict.fromkeys(each.split(calls)[0] for each in recipe.expect.values())
    nodes: dict[str, Metrics | None] = {}
    for node in dry(graph, [Address(call) for call in wanted], session.store):
        # The metrics of a bare result are in the store.
        known = session.store.actions.known(node.key) if node.key and (node.status == "cached" or node.bare) else None
        nodes[node.address] = known.metrics if known else None
    return list(judge(recipe.expect, nodes))


def cells(found: Sequence[Verdict]) -> list[dict[str, str]]:
    """Rows of a table: metric, value, interval, bound, verdict."""
    return [
        {
            "metric": f"{each.node}.{each.metric}",
            "value": "-" if each.value is None else f"{each.value:.4g} {each.unit}".strip(),
            "interval": "{:.4g} to {:.4g}".format(*each.interval) if each.interval else "-",
            "bound": each.expected.bound,
            "verdict": "not built" if each.value is None else "ok" if each.ok else "MISSED",
        }
        for each in found
    ]


def rows(found: Sequence[Verdict]) -> list[dict[str, Any]]:
    """The same as data."""
    return [
        {
            "node": each.node,
            "metric": each.metric,
            "value": each.value,
            "unit": each.unit,
            "interval": each.interval,
            "bound": each.expected.bound,
            "ok": None if each.value is None else each.ok,
        }
        for each in found
    ]


def refuse(recipe: str, found: Sequence[Verdict], *, needs_all: bool) -> None:
    """Refuse results that miss a bound and, with `needs_all`, bounds for nodes that are not built.

    Raises:
        RuleError: A bound is missed.
        StaleError: A node is not built.
    """
    missed = [each for each in found if each.value is not None and not each.ok]
    if missed:
        facts: Mapping[str, str] = {row["metric"]: f"{row['value']}, expected {row['bound']}" for row in cells(missed)}
        raise RuleError(
            f"`{recipe}` misses {count(len(missed), 'bound')} of {len(found)}",
            code="DXB-B405",
            where=missed[0].expected.where,
            facts=facts,
            hint=f"`dxb show '{recipe}:{missed[0].node}'`; `dxb report {recipe}`",
        )
    absent = list(dict.fromkeys(each.node for each in found if each.value is None))
    if absent and needs_all:
        raise StaleError(
            f"bounds of `{recipe}` cannot be checked: {count(len(absent), 'node')} not built",
            code="DXB-C105",
            facts={"nodes": ", ".join(absent)},
            hint=f"`dxb build {recipe}`",
        )

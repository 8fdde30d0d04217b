"""Bounds that a recipe states for the metrics of its nodes: `metrics.mask_iou: '>= 0.9'`. They are in no key."""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass

from dextera_build.engine.graph import Graph, parse_address
from dextera_build.errors import Place, RecipeError, did_you_mean, listing
from dextera_build.recipe.strict_yaml import Node

_BOUND = re.compile(r"\s*(>=|<=|==|>|<)\s*(all|[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*")
_STEP = re.compile(r"([^.\[\]]+)(?:\[([^\]]+)\])?\.")
_COMPARE: Mapping[str, Callable[[float, float], bool]] = {
    ">=": operator.ge,
    "<=": operator.le,
    "==": math.isclose,
    ">": operator.gt,
    "<": operator.lt,
}
_EVERY = "*"
STAND_INS = "stub"
"""Profile whose results are stand-ins, to which no bound applies."""

Metrics = Mapping[str, tuple[float, str]]
"""Name -> (value, unit), as `ctx.metric` records them."""


@dataclass(frozen=True)
class Expectation:
    """One bound as written."""

    name: str
    """`body[*].mesh.mask_iou`: a node, then a metric."""
    sign: str
    limit: float | None
    """None is `all`: the total of a metric that counts."""
    where: Place
    """Place of the name."""

    @property
    def bound(self) -> str:
        """`>= 0.9`."""
        return f"{self.sign} {'all' if self.limit is None else f'{self.limit:g}'}"

    def split(self, calls: Collection[tuple[str, ...]]) -> tuple[tuple[str, ...], tuple[str, ...], str]:
        """The call, a label or `*` for each group around it, and the name of the metric.

        Raises:
            RecipeError: The name begins with no call.
        """
        names, labels, place = list[str](), list[str](), 0
        while (step := _STEP.match(self.name, place)) is not None:
            names.append(step[1])
            labels.append(step[2] or _EVERY)
            place = step.end()
            if tuple(names) in calls and labels[-1] == _EVERY:
                return tuple(names), tuple(labels[:-1]), self.name[place:]
        known = [".".join(call) for call in calls]
        given = "" if self.name in known else self.name.rpartition(".")[0]
        raise self.unknown(f"`{self.name}` names no metric of a node", "nodes", known, given)

    def unknown(self, message: str, what: str, known: Collection[str], given: str) -> RecipeError:
        """The error for a name that does not exist."""
        return RecipeError(
            message,
            code="DXB-R133",
            where=self.where,
            facts={what: listing(known, most=40)},
            hint=did_you_mean(given, known)
            or "`NODE.METRIC: '>= 0.9'`; a copy is `body[mug].mesh`, every copy `body[*].mesh`",
        )


@dataclass(frozen=True)
class Verdict:
    """One bound, compared with one node."""

    expected: Expectation
    node: str
    metric: str
    """As the rule names it; as the recipe does if the node is not built."""
    value: float | None = None
    """None if the node is not built."""
    unit: str = ""
    interval: tuple[float, float] | None = None
    """From the metrics `NAME, low` and `NAME, high`, if the rule gives them."""
    ok: bool = False


def read(node: Node | None) -> dict[str, Expectation]:
    """The section `expect` of a recipe.

    Raises:
        RecipeError: A bound is not of the form `OP VALUE`.
    """
    if node is None or node.value is None:
        return {}
    if not isinstance(node.value, dict):
        raise RecipeError(f"`expect` is a mapping, this is {node.kind}", code="DXB-R112", where=node.place)
    found = {}
    for name, place, inner in node.entries():
        bound = _BOUND.fullmatch(inner.value) if isinstance(inner.value, str) else None
        if bound is None or (bound[2] == "all" and bound[1] != "=="):
            raise RecipeError(
                f"the bound of `{name}` is not of the form `OP VALUE`",
                code="DXB-R132",
                where=inner.place,
                hint="`'>= 0.9'`, `'<= 3'`, `'> 0'`, `'< 1'`, `'== 4'`, or `'== all'` for a metric that counts",
            )
        found[name] = Expectation(name, bound[1], None if bound[2] == "all" else float(bound[2]), place)
    return found


def refuse_unknown(expected: Mapping[str, Expectation], graph: Graph) -> None:
    """Refuse bounds for nodes that the recipe does not have.

    Raises:
        RecipeError: A bound names no node.
    """
    calls = {call for call, _ in graph.calls()} if expected else set()
    for each in expected.values():
        each.split(calls)


def judge(expected: Mapping[str, Expectation], nodes: Mapping[str, Metrics | None]) -> Iterator[Verdict]:
    """Compare every bound with every node that it names.

    Args:
        expected: The bounds.
        nodes: Address -> metrics, None if the node is not built; `body.mesh` for copies that are not known yet.

    Raises:
        RecipeError: There is no such node, copy or metric.
    """
    known = {name: parse_address(name) for name in nodes}
    calls = {address.call for address in known.values()}
    for each in expected.values():
        call, labels, metric = each.split(calls)
        same = {name: address.labels or () for name, address in known.items() if address.call == call}
        found = [
            name for name, given in same.items() if all(w in (_EVERY, g) for w, g in zip(labels, given, strict=False))
        ]
        if not found:
            copies = sorted({given[-1] for given in same.values() if given})
            raise each.unknown(f"`{each.name}` names no copy", "copies", copies, labels[-1])
        for name in found:
            yield _judged(each, name, metric, nodes[name])


def _judged(each: Expectation, node: str, metric: str, metrics: Metrics | None) -> Verdict:
    if metrics is None:
        return Verdict(each, node, metric)
    name = next((name for name in metrics if metric == name), None)
    name = name or next((name for name in metrics if _plain(name) == _plain(metric)), None)
    if name is None:
        names = [*map(_plain, metrics)]
        raise each.unknown(f"`{node}` has no metric `{metric}`", "metrics", names, _plain(metric))
    value, unit = metrics[name]
    ends = [metrics[f"{name}, {end}"][0] for end in ("low", "high") if f"{name}, {end}" in metrics]
    ok = _COMPARE[each.sign](value, _total(each, name, unit) if each.limit is None else each.limit)
    return Verdict(each, node, name, value, unit, (ends[0], ends[1]) if len(ends) == 2 else None, ok)


def _total(each: Expectation, metric: str, unit: str) -> float:
    """4 of the unit `of 4`."""
    total = re.search(r"\bof (\d+)$", unit)
    if total is None:
        raise RecipeError(
            f"`all` is the total of a metric that counts, and `{metric}` does not",
            code="DXB-R134",
            where=each.where,
            facts={"its unit": unit or "none"},
            hint="compare it with a number",
        )
    return float(total[1])


def _plain(name: str) -> str:
    """The name of a metric as recipes write it: `mask_iou` for `Mask IoU`."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")

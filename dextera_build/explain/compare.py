"""Differences between two results, or between all results of two runs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from dextera_build.artifacts.comparison.difference import Difference, differences
from dextera_build.engine.key import compare
from dextera_build.explain.causes import short
from dextera_build.explain.origins import document
from dextera_build.report.wording import number
from dextera_build.store.blobs import MissingBlob

if TYPE_CHECKING:
    from dextera_build.explain.runs import Events
    from dextera_build.store.store import Store


@dataclass(frozen=True)
class Side:
    """One result: its key and its output."""

    name: str
    """Its name in messages."""
    key: str | None = None
    output: str | None = None
    status: str = ""
    """Status of the node in its run; "" outside a run."""


@dataclass(frozen=True)
class Row:
    """One difference."""

    kind: str
    """A kind of `engine.key`, or `key`, `output`, `metric`, `status`, `only`, `lost`."""
    name: str
    change: str
    output: Difference | None = field(default=None, repr=False)
    """Details of a difference in the output."""

    def to_json(self) -> dict[str, Any]:
        """As plain data."""
        found = self.output if self.output is not None and self.output.largest is not None else None
        return {
            "kind": self.kind,
            "name": self.name,
            "change": self.change,
            "largest": found and found.largest,
            "changed": found and found.changed,
            "total": found and found.total,
            "motion": found.motion.to_json() if found and found.motion else None,
        }


def rows(store: Store, old: Side, new: Side) -> list[Row]:
    """All differences between two results: status, key documents, outputs, metrics."""
    found = [Row("status", "status", f"{old.status} -> {new.status}")] if _ended(old) != _ended(new) else []
    return [*found, *_keys(store, old, new), *_outputs(store, old, new), *_metrics(store, old, new)]


def run_rows(store: Store, old: Events, new: Events) -> dict[str, list[Row]]:
    """Node -> its differences, for the nodes that differ between two runs."""
    before, after = nodes(old), nodes(new)
    found = {}
    for node in dict.fromkeys([*before, *after]):
        if node not in before or node not in after:
            found[node] = [Row("only", node, "new" if node in after else "gone")]
        elif told := rows(store, before[node], after[node]):
            found[node] = told
    return found


def nodes(events: Events) -> dict[str, Side]:
    """Address -> final state of each node of a run."""
    return {
        event["node"]: Side(event["node"], event["key"], event["output"], event["status"])
        for event in events
        if event["event"] == "node_finished"
    }


def _ended(side: Side) -> str:
    """The status to compare: the origin of a result makes no difference."""
    return "" if side.status in ("", "ran", "cached", "fetched") else side.status


def _keys(store: Store, old: Side, new: Side) -> Iterator[Row]:
    if old.key == new.key or old.key is None or new.key is None:
        return
    before, after = document(store, old.key), document(store, new.key)
    if before is None or after is None:
        yield Row("lost", "key", f"{old.key[:12]} -> {new.key[:12]}, whose document is not in the store")
        return
    for change in compare(before, after):
        yield Row(change.kind, change.name, f"{short(change.old)} -> {short(change.new)}")


def _outputs(store: Store, old: Side, new: Side) -> Iterator[Row]:
    if old.output == new.output or old.output is None or new.output is None:
        return
    try:
        for found in differences(old.output, new.output, store.blobs.get):
            yield Row("output", found.path or "type", str(found), found)
    except MissingBlob as error:
        yield Row("lost", "output", f"{old.output[:12]} -> {new.output[:12]}; {error.message}")


def _metrics(store: Store, old: Side, new: Side) -> Iterator[Row]:
    before, after = _measured(store, old), _measured(store, new)
    for name in dict.fromkeys([*before, *after]):
        if before.get(name) != after.get(name):
            yield Row("metric", name, f"{_value(before.get(name))} -> {_value(after.get(name))}")


def _value(metric: tuple[float, str] | None) -> str:
    return f"{number(metric[0])} {metric[1]}".strip() if metric is not None else "none"


def _measured(store: Store, side: Side) -> Mapping[str, tuple[float, str]]:
    found = store.actions.known(side.key) if side.key else None
    return found.metrics if found is not None and found.output == side.output else {}

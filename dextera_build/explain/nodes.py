"""The nodes of a recipe with what they read: as the last runs saw them, or from the recipe where it was never built."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from dextera_build.engine.graph import Call, Gather, Graph, Item, Output, node_address, parts_of
from dextera_build.runs import log
from dextera_build.store.store import Store

if TYPE_CHECKING:
    from dextera_build.engine.graph import Input

_RUNS = 10
"""How many runs of a recipe are looked through for nodes that the last one did not need."""
_LABEL = re.compile(r"\[[^\]]*\]")


@dataclass(frozen=True)
class Known:
    """A node as far as it is known without a plan."""

    address: str
    rule: str
    backend: str | None = None
    status: str = "unknown"
    """What it came to in the run that knows it."""
    depends_on: tuple[str, ...] = ()
    seconds: float = 0.0
    usage: Mapping[str, float] = field(default_factory=dict)

    @property
    def call(self) -> str:
        """The address without labels."""
        return _LABEL.sub("", self.address)


def of_runs(store: Store, recipe: str, most: int = _RUNS) -> dict[str, Known]:
    """Nodes by address, the copies of each call as the last of `most` runs that needed the call saw them."""
    found: dict[str, Known] = {}
    calls: set[str] = set()
    seen = 0
    for run in reversed(log.runs(store)):
        events = iter(log.lines(store, run))
        if next(events, {}).get("recipe") != recipe:
            continue
        nodes = of_events(events)
        found |= {address: node for address, node in nodes.items() if node.call not in calls}
        calls |= {node.call for node in nodes.values()}
        seen += 1
        if seen == most:
            break
    return found


def of_events(events: Iterable[Mapping[str, Any]]) -> dict[str, Known]:
    """The nodes of one run, by address."""
    return {
        event["node"]: Known(
            address=event["node"],
            rule=event["rule"],
            backend=event["backend"],
            status=event["status"],
            depends_on=tuple(event["depends_on"]),
            seconds=event["seconds"],
            usage=event.get("usage", {}),
        )
        for event in events
        if event["event"] == "node_finished" and event["rule"] != "each"
    }


def of_graph(graph: Graph) -> dict[str, Known]:
    """The calls of a plan, `body[*].mesh` for those of a group."""
    return {
        _starred(path): Known(
            _starred(path), call.rule.path, call.rule.backend, depends_on=tuple(dict.fromkeys(_read(graph, call)))
        )
        for path, call in graph.calls()
    }


def _read(graph: Graph, call: Call) -> Iterable[str]:
    stack: list[Input] = list(reversed(list(call.inputs.values())))
    while stack:
        for part in parts_of(stack.pop()):
            if isinstance(part, Output | Gather):
                yield _starred(part.call)
            elif isinstance(part, Item):
                member: Any = graph.members[part.group[0]]
                for name in part.group[1:]:
                    member = member.members[name]
                stack.append(member.over)


def _starred(call: tuple[str, ...]) -> str:
    return node_address(call, ("*",) * (len(call) - 1))


def walk(nodes: Mapping[str, Known], start: Iterable[str], *, readers: bool, depth: int | None) -> list[str]:
    """What `start` reads, or what reads it, nearest first.

    Args:
        nodes: By address.
        start: Addresses; they are part of the answer only where one of them leads to another.
        readers: Against the arrows.
        depth: How many steps; None is as many as there are.
    """
    ahead: Mapping[str, Iterable[str]] = {address: node.depends_on for address, node in nodes.items()}
    if readers:
        turned: dict[str, list[str]] = {}
        for address, sources in ahead.items():
            for source in sources:
                turned.setdefault(source, []).append(address)
        ahead = turned
    found: dict[str, None] = {}
    front, step = list(start), 0
    while front and (depth is None or step < depth):
        front = list(dict.fromkeys(near for far in front for near in ahead.get(far, ()) if near in nodes))
        front = [address for address in front if address not in found]
        found |= dict.fromkeys(front)
        step += 1
    return list(found)


def pattern(glob: str) -> re.Pattern[str]:
    """A glob as a regular expression: `*` is any characters, `?` one; brackets stand for themselves."""
    return re.compile("".join({"*": ".*", "?": "."}.get(c, re.escape(c)) for c in glob))


def matching(nodes: Mapping[str, Known], glob: str) -> list[str]:
    """Addresses that a glob names; one without labels names every copy: `body.mesh`."""
    wanted = pattern(glob)
    return [address for address, node in nodes.items() if wanted.fullmatch(address) or wanted.fullmatch(node.call)]

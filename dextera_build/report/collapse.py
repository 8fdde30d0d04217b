"""A graph with fewer nodes: one for each call of a group, for each rule, or for each used recipe."""

from __future__ import annotations

import re
from collections.abc import Sequence

from dextera_build.report.run import Node
from dextera_build.report.wording import count

WAYS = ("node", "group", "rule", "recipe")
"""The nodes that one box represents; `group`: all copies of a call."""

_LABEL = re.compile(r"\[[^\]]*\]")
_WORST = ("failed", "waits", "cancelled", "stale", "unknown", "ran", "fetched", "cached", "")


def collapse(nodes: Sequence[Node], way: str) -> list[Node]:
    """Merge nodes that are alike by one of `WAYS` into one with all their inputs and the worst of their states.

    Rules and recipes may form cycles although nodes do not.
    """
    if way == "node":
        return list(nodes)
    place = {node.address: _name(node, way) for node in nodes}
    boxes = members(nodes, way)
    return [_one(index, address, inside, place) for index, (address, inside) in enumerate(boxes.items())]


def members(nodes: Sequence[Node], way: str) -> dict[str, list[Node]]:
    """The nodes that each box of `collapse` represents, by the address of the box."""
    boxes: dict[str, list[Node]] = {}
    for node in nodes:
        boxes.setdefault(_name(node, way), []).append(node)
    return boxes


def _name(node: Node, way: str) -> str:
    if way == "node":
        return node.address
    if way == "rule":
        return node.rule
    if way == "group":
        return _LABEL.sub("[*]", node.address)
    first = node.call[0]
    cut = max(first.rfind(":"), first.rfind("/"))
    return first[:cut] if cut > 0 else "(its own nodes)"


def _one(index: int, address: str, members: Sequence[Node], place: dict[str, str]) -> Node:
    sources = dict.fromkeys(place[source] for node in members for source in node.depends_on if source in place)
    rules = sorted({node.rule for node in members})
    words = rules[0] if len(rules) == 1 and rules[0] != address else count(len(members), "node")
    if len(members) > 1 and words == rules[0]:
        words = f"{len(members)} × {words}"
    return Node(
        index=index,
        address=address,
        rule=words,
        backend=None,
        status=min((node.status for node in members), key=_WORST.index),
        key=None,
        output=None,
        began=0.0,
        ended=sum(node.seconds for node in members),
        depends_on=[source for source in sources if source != address],
    )

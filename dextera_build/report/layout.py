"""Positions of a run's nodes in the drawing: columns by dependency, one lane per copy of a group."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from dextera_build.report.run import Node, Run

Call = tuple[str, ...]


@dataclass(frozen=True)
class Cell:
    """A node's place on the grid."""

    node: Node
    column: int
    row: int


@dataclass
class Lane:
    """The nodes of one copy of a group, or those outside every group."""

    title: tuple[str, ...]
    """Group and label; () for the nodes outside."""
    top: int
    """First row."""
    rows: int
    cells: list[Cell] = field(default_factory=list)


@dataclass
class Layout:
    """Lanes from top to bottom, and the edges that are drawn."""

    lanes: list[Lane]
    columns: int
    rows: int
    edges: list[tuple[Node, Node]]
    hidden: int
    """Copies of groups that are not drawn because there are too many."""


def lay_out(run: Run, most_lanes: int = 16) -> Layout:
    """Place every node; copies of a call have the same column, and the same row of their lane.

    Args:
        run: The run.
        most_lanes: Copies of a group that are drawn; failed ones go first.
    """
    column = _columns(run)
    row, height = _rows(run, column)
    lanes: list[Lane] = []
    top = hidden = 0
    for group, titles in _lanes(run).items():
        shown = _worst_first(titles, most_lanes)
        hidden += len(titles) - len(shown)
        for title, nodes in shown:
            cells = [Cell(node, column[node.call], top + row[node.call]) for node in nodes]
            lanes.append(Lane(title, top, height[group], cells))
            top += height[group]
    drawn = {cell.node.address for lane in lanes for cell in lane.cells}
    edges = [(a, b) for a, b in reduced(run.nodes) if a.address in drawn and b.address in drawn]
    return Layout(lanes, max(column.values(), default=0) + 1, top, edges, hidden)


def reduced(nodes: Sequence[Node]) -> list[tuple[Node, Node]]:
    """The edges that are not implied by a longer path."""
    order = topological(nodes)
    bit = {node.address: 1 << i for i, node in enumerate(order)}
    rank = {node.address: i for i, node in enumerate(order)}
    above: dict[str, int] = {}
    edges = []
    for node in order:
        seen = 0
        for name in sorted({d for d in node.depends_on if d in rank}, key=lambda d: -rank[d]):
            if not seen & bit[name]:
                edges.append((order[rank[name]], node))
            seen |= above.get(name, 0) | bit[name]  # a cycle has a back edge
        above[node.address] = seen
    return edges


def topological(nodes: Sequence[Node]) -> list[Node]:
    """Nodes in topological order; iterative, and still an order if a broken log has a cycle."""
    known = {node.address: node for node in nodes}
    done: dict[str, Node] = {}
    for root in nodes:
        stack = [root]
        entered: set[str] = set()
        while stack:
            node = stack[-1]
            entered.add(node.address)
            todo = [known[d] for d in node.depends_on if d in known and d not in done and d not in entered]
            if todo:
                stack += todo
                continue
            stack.pop()
            done.setdefault(node.address, node)
    return list(done.values())


def made_from(run: Run, rules: str) -> set[str]:
    """Addresses of the nodes whose rule begins with `rules`, and of the nodes that depend on them."""
    found: set[str] = set()
    for node in topological(run.nodes):
        if node.rule.startswith(rules) or found.intersection(node.depends_on):
            found.add(node.address)
    return found


def _columns(run: Run) -> dict[Call, int]:
    """Column of every call by the longest path over calls, which aligns copies."""
    column: dict[Call, int] = {}
    by_address = run.by_address()
    for node in topological(run.nodes):
        before = [column.get(by_address[d].call, 0) + 1 for d in node.depends_on if d in by_address]
        column[node.call] = max([column.get(node.call, 0), *before])
    used = {c: i for i, c in enumerate(sorted(set(column.values())))}
    return {call: used[c] for call, c in column.items()}


def _rows(run: Run, column: dict[Call, int]) -> tuple[dict[Call, int], dict[Call, int]]:
    """Row of every call within its lane, near its inputs, and the lanes' heights by group."""
    by_address = run.by_address()
    row: dict[Call, int] = {}
    height: dict[Call, int] = {}
    taken: set[tuple[Call, int, int]] = set()
    for node in sorted(topological(run.nodes), key=lambda n: column[n.call]):
        if node.call in row:
            continue
        group = node.call[:-1]
        before = [by_address[d].call for d in node.depends_on if d in by_address]
        near = [row[call] for call in before if call[:-1] == group and call in row]
        wanted = round(sum(near) / len(near)) if near else 0
        candidates = sorted(range(wanted + 2 + len(taken)), key=lambda r: (abs(r - wanted), r))
        row[node.call] = next(r for r in candidates if (group, column[node.call], r) not in taken)
        taken.add((group, column[node.call], row[node.call]))
        height[group] = max(height.get(group, 0), row[node.call] + 1)
    return row, height


def _lanes(run: Run) -> dict[Call, dict[tuple[str, ...], list[Node]]]:
    """Group -> lane title -> nodes; the nodes outside groups first, then copies as their group opened them."""
    found: dict[Call, dict[tuple[str, ...], list[Node]]] = {}
    place = {label: i for labels in run.groups.values() for i, label in enumerate(labels)}
    for node in sorted(
        run.nodes, key=lambda n: (len(n.call), n.call[:-1], [place.get(label, 0) for label in n.labels])
    ):
        title = (*node.call[:-1], *node.labels) if len(node.call) > 1 else ()
        found.setdefault(node.call[:-1], {}).setdefault(title, []).append(node)
    return found


def _worst_first(titles: dict[tuple[str, ...], list[Node]], most: int) -> list[tuple[tuple[str, ...], list[Node]]]:
    if len(titles) <= most:
        return list(titles.items())
    ranked = sorted(titles.items(), key=lambda item: not any(n.status in ("failed", "waits") for n in item[1]))
    return ranked[:most]

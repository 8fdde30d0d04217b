"""The graph of a run as inline SVG, left to right, one lane per copy of a group."""

from __future__ import annotations

from dextera_build.report.html import Html, tag
from dextera_build.report.layout import Cell, Lane, Layout, lay_out
from dextera_build.report.run import Node, Run
from dextera_build.report.wording import MARKS, count, duration

_BOX = (102, 38)  # px: a name of 12 characters and the line below it
_STEP = (118, 46)  # px from box to box
_LEFT = 92  # px for the lanes' titles, where there are groups
_PAD = 10  # px above and below the boxes of a lane


def graph(run: Run) -> Html:
    """The figure, or a sentence where the log holds no nodes."""
    if not run.nodes:
        return tag("p", {"class": "quiet"}, "The event log of this run holds no nodes.")
    layout = lay_out(run)
    tops = _tops(layout)
    left = _LEFT if any(lane.title for lane in layout.lanes) else _PAD
    width = left + layout.columns * _STEP[0] - (_STEP[0] - _BOX[0]) + _PAD
    height = tops[-1]
    boxes = {
        cell.node.index: _corner(cell, lane, top, left)
        for lane, top in zip(layout.lanes, tops, strict=False)
        for cell in lane.cells
    }
    parts = [_lane(lane, top, width, i) for i, (lane, top) in enumerate(zip(layout.lanes, tops, strict=False))]
    parts.append(tag("g", {"class": "edges"}, [_edge(a, b, boxes) for a, b in layout.edges]))
    parts += [_box(cell.node, boxes[cell.node.index]) for lane in layout.lanes for cell in lane.cells]
    label = f"graph of {count(len(run.nodes), 'node')}, from inputs on the left to results on the right"
    svg = tag(
        "svg",
        {
            "viewBox": f"0 0 {width} {height}",
            "role": "group",
            "aria-label": label,
            "style": f"width:{width}px;min-width:{round(width * 0.8)}px",
        },
        parts,
    )
    hidden = tag("p", {"class": "quiet"}, f"{layout.hidden} more copies are not drawn; they are listed under Nodes.")
    return tag(
        "div", None, tag("div", {"class": "scroll graph", "tabindex": "0"}, svg), hidden if layout.hidden else None
    )


def _tops(layout: Layout) -> list[int]:
    """Upper border of every lane, and the lower one of the last [px]."""
    tops = [0]
    for lane in layout.lanes:
        tops.append(tops[-1] + lane.rows * _STEP[1] + 2 * _PAD - (_STEP[1] - _BOX[1]))
    return tops


def _corner(cell: Cell, lane: Lane, top: int, left: int) -> tuple[int, int]:
    return left + cell.column * _STEP[0], top + _PAD + (cell.row - lane.top) * _STEP[1]


def _lane(lane: Lane, top: int, width: int, number: int) -> Html:
    height = lane.rows * _STEP[1] + 2 * _PAD - (_STEP[1] - _BOX[1])
    shade = tag("rect", {"x": 0, "y": top, "width": width, "height": height, "class": f"lane l{number % 2}"})
    if not lane.title:
        return shade
    group, label = lane.title[0], " · ".join(lane.title[len(lane.title) // 2 :])
    words = [
        tag(
            "text", {"x": 10, "y": top + height / 2 - 3, "class": "label"}, _short(label, 11), tag("title", None, label)
        ),
        tag("text", {"x": 10, "y": top + height / 2 + 11, "class": "sub"}, _short(group, 12)),
    ]
    return tag("g", None, shade, words)


def _edge(a: Node, b: Node, boxes: dict[int, tuple[int, int]]) -> Html:
    (ax, ay), (bx, by) = boxes[a.index], boxes[b.index]
    x0, y0, x1, y1 = ax + _BOX[0], ay + _BOX[1] / 2, bx, by + _BOX[1] / 2
    # A long edge leaves in the gap behind its box and comes in through the gap before its end.
    gap = _STEP[0] - _BOX[0]
    bend = min(gap * 1.6, (x1 - x0) / 2) if x1 - x0 > gap else gap / 2
    path = f"M{x0} {y0:g}C{x0 + bend:g} {y0:g} {x1 - bend:g} {y1:g} {x1} {y1:g}"
    return tag("path", {"d": path, "data-a": a.index, "data-b": b.index})


def _box(node: Node, corner: tuple[int, int]) -> Html:
    x, y = corner
    state = duration(node.seconds) if node.worked else node.status
    below = f"{state} · {node.backend}" if node.backend else state
    said = f": {node.line}" if node.line else ""
    return tag(
        "a",
        {"href": f"#n{node.index}", "class": f"node {node.status}", "data-node": node.index},
        tag("title", None, f"{node.address} ({node.rule}), {node.status}{said}"),
        tag("rect", {"x": x, "y": y, "width": _BOX[0], "height": _BOX[1], "rx": 6}),
        tag("text", {"x": x + 9, "y": y + 16, "class": "mark"}, MARKS.get(node.status, "?")),
        tag("text", {"x": x + 22, "y": y + 16, "class": "label"}, _short(node.name, 12)),
        tag("text", {"x": x + 22, "y": y + 30, "class": "sub"}, _short(below, 14)),
    )


def _short(text: str, most: int) -> str:
    return text if len(text) <= most else text[: most - 1] + "…"

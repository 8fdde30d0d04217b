"""The graph of a run as inline SVG, left to right, one lane per copy of a group."""

from __future__ import annotations

from dataclasses import dataclass

from dextera_build.report.html import Html, tag
from dextera_build.report.layout import Cell, Lane, Layout, lay_out
from dextera_build.report.run import Node, Run
from dextera_build.report.wording import MARKS, count, duration

_PAD = 10  # px above and below the boxes of a lane


@dataclass(frozen=True)
class Size:
    """Sizes in a drawing [px]."""

    box: tuple[int, int] = (102, 38)
    step: tuple[int, int] = (118, 46)
    """Distance from box to box."""
    left: int = 92
    """Width of lane titles, for graphs with groups."""
    label: int = 12
    """Maximum length of a name [characters]."""
    sub: int = 14
    """Maximum length of the line below it [characters]."""


SMALL = Size()
"""Sizes in the report."""


def graph(run: Run) -> Html:
    """The figure, or a sentence if the log holds no nodes."""
    if not run.nodes:
        return tag("p", {"class": "quiet"}, "The event log of this run holds no nodes.")
    layout = lay_out(run)
    parts, width, height = draw(layout, SMALL)
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


def draw(layout: Layout, size: Size) -> tuple[list[Html], int, int]:
    """(shapes, width, height) of a graph [px]."""
    tops = _tops(layout, size)
    left = size.left if any(lane.title for lane in layout.lanes) else _PAD
    width = left + layout.columns * size.step[0] - (size.step[0] - size.box[0]) + _PAD
    boxes = {
        cell.node.index: _corner(cell, lane, top, left, size)
        for lane, top in zip(layout.lanes, tops, strict=False)
        for cell in lane.cells
    }
    parts = [_lane(lane, top, width, i, size) for i, (lane, top) in enumerate(zip(layout.lanes, tops, strict=False))]
    parts.append(tag("g", {"class": "edges"}, [_edge(a, b, boxes, size) for a, b in layout.edges]))
    parts += [_box(cell.node, boxes[cell.node.index], size) for lane in layout.lanes for cell in lane.cells]
    return parts, width, tops[-1]


def _tops(layout: Layout, size: Size) -> list[int]:
    """Upper border of every lane, and the lower one of the last [px]."""
    tops = [0]
    for lane in layout.lanes:
        tops.append(tops[-1] + lane.rows * size.step[1] + 2 * _PAD - (size.step[1] - size.box[1]))
    return tops


def _corner(cell: Cell, lane: Lane, top: int, left: int, size: Size) -> tuple[int, int]:
    return left + cell.column * size.step[0], top + _PAD + (cell.row - lane.top) * size.step[1]


def _lane(lane: Lane, top: int, width: int, number: int, size: Size) -> Html:
    height = lane.rows * size.step[1] + 2 * _PAD - (size.step[1] - size.box[1])
    shade = tag("rect", {"x": 0, "y": top, "width": width, "height": height, "class": f"lane l{number % 2}"})
    if not lane.title:
        return shade
    group, label = lane.title[0], " · ".join(lane.title[len(lane.title) // 2 :])
    if len(lane.title) == 1:
        group = ""  # a stage of rules
    elif not label.strip("* ·"):
        group, label = "every copy", group.rpartition(":")[2]
    middle = top + height / 2
    words = [
        tag(
            "text",
            {"x": 10, "y": middle - 3, "class": "label"},
            _short(label, size.label - 1),
            tag("title", None, label),
        ),
        tag("text", {"x": 10, "y": middle + 11, "class": "sub"}, _short(group, size.label)),
    ]
    return tag("g", None, shade, words)


def _edge(a: Node, b: Node, boxes: dict[int, tuple[int, int]], size: Size) -> Html:
    (ax, ay), (bx, by) = boxes[a.index], boxes[b.index]
    x0, y0, x1, y1 = ax + size.box[0], ay + size.box[1] / 2, bx, by + size.box[1] / 2
    gap, between = size.step[0] - size.box[0], size.step[1] - size.box[1]
    if x0 <= x1 <= x0 + gap:
        path = f"M{x0} {y0:g}C{x0 + gap / 2:g} {y0:g} {x1 - gap / 2:g} {y1:g} {x1} {y1:g}"
    else:
        # A long or backward edge runs between two rows of boxes, to pass under none.
        side = 1 if by >= ay else -1
        spread = (a.index % 5 - 2) * between / 8
        level = y0 + side * (size.box[1] + between) / 2 + spread
        out, home, half = x0 + gap * 0.6, x1 - gap * 0.6, gap * 0.3
        path = (
            f"M{x0} {y0:g}C{x0 + half:g} {y0:g} {out - half:g} {level:g} {out:g} {level:g}H{home:g}"
            f"C{home + half:g} {level:g} {x1 - half:g} {y1:g} {x1} {y1:g}"
        )
    return tag("path", {"d": path, "data-a": a.index, "data-b": b.index})


def _box(node: Node, corner: tuple[int, int], size: Size) -> Html:
    x, y = corner
    state = duration(node.seconds) if node.worked else node.status
    below = " · ".join(part for part in (state, node.backend) if part) if state else node.rule
    said = f": {node.line}" if node.line else ""
    mark = MARKS.get(node.status, "")
    text = x + (22 if mark else 9)
    return tag(
        "a",
        {"href": f"#n{node.index}", "class": f"node {node.status or 'plain'}", "data-node": node.index},
        tag("title", None, f"{node.address} ({node.rule}){', ' if node.status else ''}{node.status}{said}"),
        tag("rect", {"x": x, "y": y, "width": size.box[0], "height": size.box[1], "rx": 6}),
        tag("text", {"x": x + 9, "y": y + 16, "class": "mark"}, mark) if mark else None,
        tag("text", {"x": text, "y": y + 16, "class": "label"}, _short(node.name, size.label)),
        tag("text", {"x": text, "y": y + 30, "class": "sub"}, _short(below, size.sub)),
    )


def _short(text: str, most: int) -> str:
    return text if len(text) <= most else text[: most - 1] + "…"

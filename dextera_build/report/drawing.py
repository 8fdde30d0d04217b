"""A graph as a separate file: SVG for any browser and editor, or Graphviz DOT."""

from __future__ import annotations

from collections.abc import Sequence

from dextera_build.report.flow import Size, draw
from dextera_build.report.html import Html, tag
from dextera_build.report.layout import lay_out
from dextera_build.report.run import Node, Run
from dextera_build.report.wording import MARKS, count

_PAGE = Size(box=(168, 40), step=(204, 50), left=132, label=20, sub=24)
_HEAD = 44  # px above the drawing for the title and the legend
_COLOURS = {
    "cached": ("#5b6470", "#f1f2f4"),
    "ran": ("#1a7f4b", "#e3f4ea"),
    "fetched": ("#1c6ea4", "#e2f0f9"),
    "failed": ("#b42318", "#fdeceb"),
    "waits": ("#9a6700", "#fdf3d8"),
    "cancelled": ("#9a6700", "#fdf3d8"),
    "stale": ("#9a6700", "#fdf3d8"),
    "unknown": ("#5b6470", "#ffffff"),
    "": ("#3d4a5c", "#eef2f7"),
}
"""Status -> (ink, paper)."""
_STYLE = """
svg { font: 12px system-ui, 'DejaVu Sans', sans-serif; background: #fff }
.title { font-size: 15px; font-weight: 600; fill: #1b1e23 }
.label { font-weight: 600; fill: #1b1e23 } .sub { font-size: 11px; fill: #59616d } .mark { font-weight: 700 }
.lane.l0 { fill: #fff } .lane.l1 { fill: #f6f7f8 }
.edges path { fill: none; stroke: #aab2bd; stroke-width: 1.2 }
.node rect { stroke-width: 1 } .node.unknown rect { stroke-dasharray: 4 3 }
""" + "".join(
    f".{status or 'plain'} rect {{ fill: {paper}; stroke: {ink} }} .{status or 'plain'} .mark {{ fill: {ink} }}\n"
    for status, (ink, paper) in _COLOURS.items()
)


def svg(title: str, nodes: Sequence[Node], groups: dict[str, list[str]] | None = None) -> str:
    """The graph as one SVG document, inputs on the left, one lane for each copy of a group."""
    layout = lay_out(Run(nodes=list(nodes), groups=groups or {}), most_lanes=len(nodes))
    parts, width, height = draw(layout, _PAGE)
    width = max(width, 640)
    states = [status for status in _COLOURS if status and any(node.status == status for node in nodes)]
    return tag(
        "svg",
        {
            "xmlns": "http://www.w3.org/2000/svg",
            "viewBox": f"0 0 {width} {height + _HEAD}",
            "width": width,
            "height": height + _HEAD,
            "role": "img",
            "aria-label": f"{title}: {count(len(nodes), 'node')}, from inputs on the left to results on the right",
        },
        tag("style", None, Html(_STYLE)),
        tag("text", {"x": 10, "y": 26, "class": "title"}, title),
        [_legend(status, width - 110 * (len(states) - place)) for place, status in enumerate(states)],
        tag("g", {"transform": f"translate(0 {_HEAD})"}, parts),
    )


def _legend(status: str, x: int) -> Html:
    return tag(
        "g",
        {"class": f"node {status}"},
        tag("rect", {"x": x, "y": 14, "width": 16, "height": 16, "rx": 4}),
        tag("text", {"x": x + 5, "y": 26, "class": "mark"}, MARKS.get(status, "")),
        tag("text", {"x": x + 22, "y": 26, "class": "sub"}, status),
    )


def dot(title: str, nodes: Sequence[Node]) -> str:
    """The graph in Graphviz' language: `dxb show --graph RECIPE --dot | dot -Tpdf -o graph.pdf`."""
    lines = [f"digraph {_quoted(title)} {{", "  rankdir=LR;", '  node [shape=box, style="rounded,filled"];']
    known = {node.address for node in nodes}
    for node in nodes:
        ink, paper = _COLOURS[node.status]
        label = _quoted(f"{node.address}\n{node.rule}")
        lines.append(f'  {_quoted(node.address)} [label={label}, color="{ink}", fillcolor="{paper}"];')
    for node in nodes:
        lines += [f"  {_quoted(source)} -> {_quoted(node.address)};" for source in node.depends_on if source in known]
    return "\n".join([*lines, "}"])


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n") + '"'

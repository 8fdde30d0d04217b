"""The timeline of a run: one row per worker slot, the critical path marked."""

from __future__ import annotations

from dextera_build.report.html import Attributes, Html, tag
from dextera_build.report.run import Node, Run
from dextera_build.report.wording import MARKS, duration

_WIDTH = 1120  # px of the time axis
_ROW = 26  # px
_MOST = 800  # bars; only the longest are drawn


def timeline(run: Run) -> Html:
    """The figure, or a sentence if nothing ran."""
    worked = [node for node in run.nodes if node.worked]
    if not worked:
        return tag("p", {"class": "quiet"}, "Nothing ran: every result came from the store.")
    slots = assign_slots(worked)
    critical = critical_path(run)
    path = {node.index for node in critical}
    span = max([run.seconds, *(node.ended for node in worked)])
    rows = max(slots.values()) + 1
    height = rows * _ROW + 26
    drawn = sorted(worked, key=lambda n: -n.seconds)[:_MOST]
    bars = [_bar(n, slots[n.index], span, n.index in path) for n in sorted(drawn, key=lambda n: n.began)]
    busy = sum(node.seconds for node in worked)
    spent = sum(node.seconds for node in critical)
    words = tag(
        "p",
        {"class": "quiet"},
        f"{duration(busy)} of work in {duration(span)}, {busy / max(span, 1e-9):.1f} nodes at a time on average. "
        f"Critical path (outlined): {duration(spent)} in {len(critical)} nodes: ",
        " → ".join(node.address for node in critical),
    )
    svg = tag(
        "svg",
        {"viewBox": f"0 0 {_WIDTH} {height}", "role": "group", "aria-label": "timeline of the nodes that ran"},
        _axis(span, rows * _ROW),
        bars,
    )
    return tag("div", None, tag("div", {"class": "scroll timeline", "tabindex": "0"}, svg), words)


def assign_slots(worked: list[Node]) -> dict[int, int]:
    """Node index -> row: the first row that is free when the node begins."""
    free: list[float] = []
    slots: dict[int, int] = {}
    for node in sorted(worked, key=lambda n: (n.began, n.index)):
        # The engine may begin the next node a moment before it logs the end of the previous one.
        row = next((i for i, end in enumerate(free) if end <= node.began + 1e-3), len(free))
        if row == len(free):
            free.append(0.0)
        free[row] = node.ended
        slots[node.index] = row
    return slots


def critical_path(run: Run) -> list[Node]:
    """The chain of nodes that determined the end of the run, in order: each is the latest input of the next."""
    by_address = run.by_address()
    worked = [node for node in run.nodes if node.worked]
    path = [max(worked, key=lambda n: n.ended)] if worked else []
    while path:
        before = [by_address[d] for d in path[-1].depends_on if d in by_address and by_address[d].worked]
        before = [node for node in before if node not in path]
        if not before:
            break
        path.append(max(before, key=lambda n: n.ended))
    return path[::-1]


def _bar(node: Node, row: int, span: float, critical: bool) -> Html:
    x = _WIDTH * node.began / span
    width = max(_WIDTH * node.seconds / span, 1.5)
    y = row * _ROW + 3
    marked = " critical" if critical else ""
    title = f"{node.address}, {duration(node.seconds)}{', on the critical path' if critical else ''}"
    fits = int((width - 8) / 6.6)
    words = f"{MARKS[node.status]} {node.address}"
    words = words if len(words) <= fits else f"{MARKS[node.status]} {node.name}"
    text = tag("text", {"x": x + 5, "y": y + 14}, words) if len(words) <= fits else None
    rect: Attributes = {"x": f"{x:.2f}", "y": y, "width": f"{max(width - 1, 1):.2f}", "height": _ROW - 6, "rx": 3}
    return tag(
        "a",
        {"href": f"#n{node.index}", "class": f"bar {node.status}{marked}", "data-node": node.index},
        tag("title", None, title),
        tag("rect", rect),
        text,
    )


def _axis(span: float, bottom: int) -> list[Html]:
    step = _round_step(span / 8)
    out = []
    for i in range(int(span / step) + 1):
        x = _WIDTH * i * step / span
        anchor = "start" if i == 0 else "end" if x > _WIDTH - 30 else "middle"
        out.append(tag("line", {"x1": x, "x2": x, "y1": 0, "y2": bottom + 4, "class": "grid"}))
        label = f"{i * step:g} s" if span < 120 else duration(i * step) if i else "0 s"
        out.append(tag("text", {"x": x, "y": bottom + 18, "class": "sub", "text-anchor": anchor}, label))
    return out


def _round_step(least: float) -> float:
    """The next of 1, 2, 5 times a power of ten; minutes from 60 s on."""
    if least > 60:
        return 60.0 * _round_step(least / 60)
    if least > 20:
        return 60.0 if least > 30 else 30.0
    power = 1e-3
    while power * 10 <= least:
        power *= 10
    return next(power * factor for factor in (1, 2, 5, 10) if power * factor >= least * 0.999)

"""The nodes that run now, as lines at the foot of a terminal: clock, expected time, bar, what they do."""

from __future__ import annotations

from collections.abc import Sequence

from dextera_build.cli.consoles.lines import Line
from dextera_build.cli.consoles.record import Record, Running
from dextera_build.report.wording import count

_BAR = 16  # characters
_WIDE = 72  # columns from which a bar is shown


def beat(node: Running, record: Record, now: float) -> Line:
    """A line that says of a long node that it still runs: clock, expected time, how far it and the run are."""
    name, doing = node.started.node, node.doing()
    return [
        ("  ▸  ", "fetched"),
        (f"{name}  ", "name"),
        (node.clock(now), ""),
        (f"  {doing}" if doing else "", ""),
        (f"   ({counted(record)})", "dim"),
    ]


def foot(running: Sequence[Running], now: float, columns: int, rows: int) -> list[Line]:
    """Lines for the running nodes, oldest first, as many as fit into `rows`, each cut to `columns` by the caller.

    Args:
        running: Nodes that run.
        now: Seconds since the epoch.
        columns: Width of the terminal.
        rows: Most lines to return.
    """
    shown = list(running[: max(rows, 1)])
    hidden = len(running) - len(shown)
    if hidden:
        shown, hidden = shown[:-1], hidden + 1
    width = min(max((len(r.started.node) for r in shown), default=0), max(12, columns // 2 - 6))
    out = [_line(r, now, width, columns) for r in shown]
    return [*out, [(f"     and {count(hidden, 'node')} more", "dim")]] if hidden else out


def counted(record: Record) -> str:
    """`12 of 40+ nodes, 2 running, 1 failed`."""
    failed = f", {len(record.failed):,} failed" if record.failed else ""
    nodes = "node" if record.total == "1" else "nodes"
    return f"{record.done:,} of {record.total} {nodes}, {len(record.running)} running{failed}"


def _line(node: Running, now: float, width: int, columns: int) -> Line:
    name = node.started.node
    name = name if len(name) <= width else name[: width - 1] + "…"
    out: Line = [("  ▸  ", "fetched"), (f"{name:<{width}}  ", "name"), (f"{node.clock(now):<14} ", "")]
    done = node.fraction(max(0.0, now - node.started.time))
    if columns >= _WIDE:
        filled = round(_BAR * (done or 0.0))
        bar = [("━" * filled, "fetched"), ("━" * (_BAR - filled), "dim")] if done is not None else [(" " * _BAR, "")]
        out += [*bar, ("  ", "")]
    if node.progress is not None:
        out.append((node.doing(), "dim"))
    elif node.started.backend:
        out.append((node.started.backend, "dim"))
    return out

"""The nodes that run now, as lines at the foot of a terminal: clock, expected time, bar, what they do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dextera_build.cli.consoles.lines import Line, printable
from dextera_build.cli.consoles.record import Record
from dextera_build.report.wording import count, duration
from dextera_build.runs.events import NodeProgress, NodeStarted

_BAR = 16  # characters
_WIDE = 72  # columns from which a bar is shown


@dataclass
class Running:
    """One node that runs now."""

    started: NodeStarted
    progress: NodeProgress | None = None

    def fraction(self, elapsed: float) -> float | None:
        """How much is done: what the node says, else what its last time suggests; None where nothing is known."""
        if self.progress is not None and self.progress.total > 0:
            return min(1.0, self.progress.done / self.progress.total)
        if self.started.last_seconds:
            # A node that takes longer than last time is not done: the bar stops short of its end.
            return min(0.97, elapsed / self.started.last_seconds)
        return None

    def clock(self, now: float) -> str:
        """How long it runs, and how long it took the last time: `10 s of ~40 s`."""
        expected = self.started.last_seconds
        about = f" of ~{clock(max(expected, 1.0))}" if expected and expected >= 0.5 else ""
        return clock(max(0.0, now - self.started.time)) + about

    def doing(self) -> str:
        """`4/8 hypotheses`; "" where it did not say."""
        at = self.progress
        if at is None:
            return ""
        share = f"{at.done:,}/{at.total:,}" if at.total > 0 else f"{at.done:,}"
        return printable(f"{share} {at.what}".rstrip())


def beat(node: Running, record: Record, running: int, now: float) -> Line:
    """A line that says of a long node that it still runs: clock, expected time, how far it and the run are."""
    name, doing = node.started.node, node.doing()
    return [
        ("  ▸  ", "fetched"),
        (f"{name}  ", "name"),
        (node.clock(now), ""),
        (f"  {doing}" if doing else "", ""),
        (f"   ({counted(record, running)})", "dim"),
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


def counted(record: Record, running: int) -> str:
    """`12 of 40+ nodes, 2 running, 1 failed`."""
    failed = f", {len(record.failed):,} failed" if record.failed else ""
    return f"{record.done:,} of {record.total} {'node' if record.total == '1' else 'nodes'}, {running} running{failed}"


def clock(seconds: float) -> str:
    """Whole seconds, so that a ticking clock does not shake: `7 s`, `1 min 10 s`."""
    return f"{int(max(seconds, 0))} s" if seconds < 100 else duration(float(int(seconds)))


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

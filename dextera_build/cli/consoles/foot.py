"""The nodes that run now, as lines at the foot of a terminal: clock, expected time, bar, what they do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dextera_build.cli.consoles.lines import Line
from dextera_build.engine.events import NodeProgress, NodeStarted
from dextera_build.report.wording import count, duration

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


def clock(seconds: float) -> str:
    """Whole seconds, so that a ticking clock does not shake: `7 s`, `1 min 10 s`."""
    return f"{int(max(seconds, 0))} s" if seconds < 100 else duration(float(int(seconds)))


def _line(node: Running, now: float, width: int, columns: int) -> Line:
    elapsed = max(0.0, now - node.started.time)
    expected = node.started.last_seconds
    about = f" of ~{clock(max(expected, 1.0))}" if expected and expected >= 0.5 else ""
    name = node.started.node
    name = name if len(name) <= width else name[: width - 1] + "…"
    out: Line = [("  ▸  ", "fetched"), (f"{name:<{width}}  ", "name"), (f"{clock(elapsed) + about:<14} ", "")]
    done = node.fraction(elapsed)
    if columns >= _WIDE:
        filled = round(_BAR * (done or 0.0))
        bar = [("━" * filled, "fetched"), ("━" * (_BAR - filled), "dim")] if done is not None else [(" " * _BAR, "")]
        out += [*bar, ("  ", "")]
    if node.progress is not None:
        out.append((f"{node.progress.done}/{node.progress.total} {node.progress.what}".rstrip(), "dim"))
    elif node.started.backend:
        out.append((node.started.backend, "dim"))
    return out

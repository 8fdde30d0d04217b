"""The state of the run that a console shows, and the lines of running nodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dextera_build.cli.consoles import lines
from dextera_build.cli.consoles.lines import Line, printable
from dextera_build.cli.errors import render_node
from dextera_build.report.wording import count, duration
from dextera_build.runs.costs import Costs
from dextera_build.runs.events import (
    Event,
    NodeFinished,
    NodePaid,
    NodeProgress,
    NodeRetried,
    NodeStarted,
    RunFinished,
    RunSized,
    RunStarted,
    Uploaded,
    Uploading,
)


@dataclass
class Running:
    """A running node."""

    started: NodeStarted
    progress: NodeProgress | None = None
    told: float | None = None
    """Time of its last progress line in a log."""

    def clock(self, now: float) -> str:
        """Elapsed time, and the duration of its last run: `10 s of ~40 s`."""
        expected = self.started.last_seconds
        about = f" of ~{clock(max(expected, 1.0))}" if expected and expected >= 0.5 else ""
        return clock(max(0.0, now - self.started.time)) + about

    def doing(self) -> str:
        """`4/8 hypotheses`; "" if it reported no progress."""
        at = self.progress
        if at is None:
            return ""
        share = f"{at.done:,}/{at.total:,}" if at.total > 0 else f"{at.done:,}"
        return printable(f"{share} {at.what}".rstrip())


def clock(seconds: float) -> str:
    """Whole seconds, for a steady display: `7 s`, `1 min 10 s`."""
    return f"{int(max(seconds, 0))} s" if seconds < 100 else duration(float(int(seconds)))


class Record:
    """The running, failed and blocked nodes of a run, and its node counts."""

    def __init__(self) -> None:
        self._forget()

    def _forget(self) -> None:
        self.run = ""
        self.recipe = ""
        self.nodes = 0
        self.unopened = 0
        self._done: set[str] = set()
        self.uploading: Uploading | None = None
        self._uploaded: list[Uploaded] = []
        self._costs = Costs()
        self.running: dict[str, Running] = {}
        self.failed: list[NodeFinished] = []
        self.left_over: list[NodeFinished] = []
        """Waiting and cancelled nodes; shown at the end, because there may be many."""

    @property
    def done(self) -> int:
        """Number of nodes that are up to date or finished."""
        return len(self._done)

    @property
    def total(self) -> str:
        """Number of nodes; `12+` until all groups are open, because their copies are not known before."""
        return f"{self.nodes:,}{'+' if self.unopened else ''}"

    def follow(self, event: Event) -> None:
        """Update the state from one event."""
        if isinstance(event, RunStarted):
            self._forget()
            self.run, self.recipe, self.nodes = event.run, event.recipe, event.calls
        elif isinstance(event, RunSized):
            self.nodes, self.unopened = event.nodes, event.unopened
        elif isinstance(event, Uploading):
            self.uploading = event
        elif isinstance(event, Uploaded):
            self._uploaded.append(event)
        elif isinstance(event, NodePaid):
            self._costs.add(event.service, event.usd, sure=event.sure)
        elif isinstance(event, NodeStarted):
            self.running[event.node] = Running(event)
        elif isinstance(event, NodeProgress) and event.node in self.running:
            self.running[event.node].progress = event
        elif isinstance(event, NodeRetried | NodeFinished):
            self.running.pop(event.node, None)
            if isinstance(event, NodeFinished):
                self._end(event)

    def _end(self, event: NodeFinished) -> None:
        if event.status in ("cached", "ran", "fetched"):
            self._done.add(event.node)
        elif event.status == "failed":
            self.failed.append(event)
        else:
            self.left_over.append(event)

    def failures(self, *, colour: bool) -> list[str]:
        """One block of text per failed node."""
        return [
            render_node(
                node, [left.node for left in self.left_over if node.node in left.blocked_by], self.run, colour=colour
            )
            for node in self.failed
        ]

    def closing(self, event: RunFinished) -> list[Line]:
        """The last lines of a run."""
        sent = [line for uploaded in self._uploaded for line in lines.uploaded(uploaded)]
        before = event.counts.get("cached", 0)
        sent += [lines.unsent(self.recipe, each, before) for each in self._uploaded if each.results and before]
        return [lines.summary(self.recipe, event), *lines.costs(self._costs), *sent]


def beat(node: Running, record: Record, now: float) -> Line:
    """Progress line of a long-running node: clock, expected time, progress of the node and of the run."""
    return [*_line(node, node.started.node, now), (f"   ({counted(record)})", "dim")]


def foot(running: Sequence[Running], now: float, columns: int, rows: int) -> list[Line]:
    """Lines for the running nodes, oldest first, at most `rows`; the caller cuts each to `columns`.

    Args:
        running: Running nodes.
        now: Seconds since the epoch.
        columns: Width of the terminal.
        rows: Maximum number of lines.
    """
    shown = list(running[: max(rows, 1)])
    hidden = len(running) - len(shown)
    if hidden:
        shown, hidden = shown[:-1], hidden + 1
    names = [one.started.node for one in shown]
    width = min(max(map(len, names), default=0), max(12, columns // 2 - 6))
    cut = [name if len(name) <= width else f"{name[: width - 1]}…" for name in names]
    out = [_line(one, f"{name:<{width}}", now) for one, name in zip(shown, cut, strict=True)]
    return [*out, [(f"     and {count(hidden, 'node')} more", "dim")]] if hidden else out


def counted(record: Record) -> str:
    """`12 of 40+ nodes, 2 running, 1 failed`."""
    failed = f", {len(record.failed):,} failed" if record.failed else ""
    nodes = "node" if record.total == "1" else "nodes"
    return f"{record.done:,} of {record.total} {nodes}, {len(record.running)} running{failed}"


def _line(node: Running, name: str, now: float) -> Line:
    doing = node.doing() or node.started.backend or ""
    return [("  ▸  ", "fetched"), (f"{name}  ", "name"), (node.clock(now), ""), (f"  {doing}" if doing else "", "dim")]

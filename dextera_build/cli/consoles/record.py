"""What a console remembers of the run that it shows."""

from __future__ import annotations

from dataclasses import dataclass

from dextera_build.cli.consoles import lines
from dextera_build.cli.consoles.lines import Line, printable
from dextera_build.cli.errors import render_node
from dextera_build.report.wording import duration
from dextera_build.runs.events import (
    Event,
    NodeFinished,
    NodeProgress,
    NodeRetried,
    NodeStarted,
    RunFinished,
    RunSized,
    RunStarted,
    Uploaded,
)


@dataclass
class Running:
    """One node that runs now."""

    started: NodeStarted
    progress: NodeProgress | None = None
    told: float | None = None
    """When a log last said that it still runs."""

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


def clock(seconds: float) -> str:
    """Whole seconds, so that a ticking clock does not shake: `7 s`, `1 min 10 s`."""
    return f"{int(max(seconds, 0))} s" if seconds < 100 else duration(float(int(seconds)))


class Record:
    """Running nodes, failures, what waits for them, and how many nodes there are."""

    def __init__(self) -> None:
        self._forget()

    def _forget(self) -> None:
        self.run = ""
        self.recipe = ""
        self.nodes = 0
        self.unopened = 0
        self._done: set[str] = set()
        self._uploads: list[Uploaded] = []
        self.running: dict[str, Running] = {}
        self.failed: list[NodeFinished] = []
        self.left_over: list[NodeFinished] = []
        """Waiting and cancelled nodes; told at the end, because they may be many."""

    @property
    def done(self) -> int:
        """How many nodes need no more work, in this run or at all."""
        return len(self._done)

    @property
    def total(self) -> str:
        """How many nodes there are; `12+` as long as groups are not open, because their copies are not known."""
        return f"{self.nodes:,}{'+' if self.unopened else ''}"

    def follow(self, event: Event) -> None:
        """Take note of one event."""
        if isinstance(event, RunStarted):
            self._forget()
            self.run, self.recipe, self.nodes = event.run, event.recipe, event.calls
        elif isinstance(event, RunSized):
            self.nodes, self.unopened = event.nodes, event.unopened
        elif isinstance(event, Uploaded):
            self._uploads.append(event)
        elif isinstance(event, NodeStarted):
            self.running[event.node] = Running(event)
        elif isinstance(event, NodeProgress) and event.node in self.running:
            self.running[event.node].progress = event
        elif isinstance(event, NodeRetried):
            self.running.pop(event.node, None)
        elif isinstance(event, NodeFinished):
            self.running.pop(event.node, None)
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
        last = [lines.summary(self.recipe, event), *(line for sent in self._uploads for line in lines.uploaded(sent))]
        fresh = event.ok and event.counts.get("cached", 0) != sum(event.counts.values())
        return [*last, lines.next_steps(self.recipe)] if fresh else last

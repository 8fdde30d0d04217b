"""What a console remembers of the run that it shows."""

from __future__ import annotations

import re

from dextera_build.cli.consoles import lines
from dextera_build.cli.consoles.lines import Line
from dextera_build.cli.errors import render_node
from dextera_build.engine.events import Event, GroupOpened, NodeFinished, RunFinished, RunStarted

_LABEL = re.compile(r"\[[^\]]*\]")


class Record:
    """Failures, what waits for them, and how many nodes there are."""

    def __init__(self) -> None:
        self._forget()

    def _forget(self) -> None:
        self.run = ""
        self.recipe = ""
        self.nodes = 0
        self.done = 0
        self.failed: list[NodeFinished] = []
        self.left_over: list[NodeFinished] = []
        """Waiting and cancelled nodes; told at the end, because they may be many."""
        self._opened: set[str] = set()

    def follow(self, event: Event) -> None:
        """Take note of one event."""
        if isinstance(event, RunStarted):
            self._forget()
            self.run, self.recipe, self.nodes = event.run, event.recipe, event.calls
        elif isinstance(event, GroupOpened):
            self._open(event)
        elif isinstance(event, NodeFinished):
            self.done += 1
            if event.status == "failed":
                self.failed.append(event)
            elif event.status in ("waits", "cancelled"):
                self.left_over.append(event)

    def _open(self, event: GroupOpened) -> None:
        """The first opening of a group replaces its calls, counted once so far, by copies of them."""
        self.nodes += event.nodes
        group = _LABEL.sub("", event.group)
        if event.labels and group not in self._opened:
            self.nodes -= event.nodes // len(event.labels)
            self._opened.add(group)

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
        last = lines.summary(self.recipe, event)
        fresh = event.ok and event.counts.get("cached", 0) != sum(event.counts.values())
        return [last, lines.next_steps(self.recipe)] if fresh else [last]

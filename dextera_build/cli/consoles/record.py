"""What a console remembers of the run that it shows."""

from __future__ import annotations

from dextera_build.cli.consoles import lines
from dextera_build.cli.consoles.lines import Line
from dextera_build.cli.errors import render_node
from dextera_build.engine.events import Event, GroupOpened, NodeFinished, RunFinished, RunStarted


class Record:
    """Failures, what waits for them, and how many nodes there are."""

    def __init__(self) -> None:
        self.run = ""
        self.recipe = ""
        self.nodes = 0
        self.done = 0
        self.failed: list[NodeFinished] = []
        self.waiting: list[NodeFinished] = []

    def follow(self, event: Event) -> None:
        """Take note of one event."""
        if isinstance(event, RunStarted):
            self.run, self.recipe, self.nodes = event.run, event.recipe, event.calls
        elif isinstance(event, GroupOpened):
            self.nodes += event.nodes
        elif isinstance(event, NodeFinished):
            self.done += 1
            if event.status == "failed":
                self.failed.append(event)
            elif event.status == "waits":
                self.waiting.append(event)

    def failures(self, *, colour: bool) -> list[str]:
        """One block of text per failed node."""
        return [
            render_node(node, [w.node for w in self.waiting if node.node in w.blocked_by], self.run, colour=colour)
            for node in self.failed
        ]

    def closing(self, event: RunFinished) -> list[Line]:
        """The last lines of a run."""
        last = lines.summary(self.recipe, event)
        fresh = event.ok and event.counts.get("cached", 0) != sum(event.counts.values())
        return [last, lines.next_steps(self.recipe)] if fresh else [last]

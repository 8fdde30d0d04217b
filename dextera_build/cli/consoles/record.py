"""What a console remembers of the run that it shows."""

from __future__ import annotations

from dextera_build.cli.consoles import lines
from dextera_build.cli.consoles.lines import Line
from dextera_build.cli.errors import render_node
from dextera_build.runs.events import Event, NodeFinished, RunFinished, RunSized, RunStarted, Uploaded


class Record:
    """Failures, what waits for them, and how many nodes there are.

    Args:
        counts: Somebody asks how many are done; of a hundred thousand the names that takes fill 4 MB.
    """

    def __init__(self, *, counts: bool = False) -> None:
        self._counts = counts
        self._forget()

    def _forget(self) -> None:
        self.run = ""
        self.recipe = ""
        self.nodes = 0
        self.unopened = 0
        self._done: set[str] = set()
        self._uploads: list[Uploaded] = []
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
        elif isinstance(event, NodeFinished):
            if self._counts and event.status in ("cached", "ran", "fetched"):
                self._done.add(event.node)
            if event.status == "failed":
                self.failed.append(event)
            elif event.status in ("waits", "cancelled"):
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

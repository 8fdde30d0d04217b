"""Between the queue and the executor: locks, tasks and their outcomes."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from dextera_build.engine.discovered import Reading
from dextera_build.engine.policy import RunPolicy
from dextera_build.engine.publish import log_of, publish
from dextera_build.engine.remote_results import Sharing
from dextera_build.engine.states import State
from dextera_build.engine.units import End, Node, States
from dextera_build.errors import DxbError
from dextera_build.runs import events
from dextera_build.runs.events import Listener
from dextera_build.runs.history import History
from dextera_build.store.backoff import backoff
from dextera_build.store.entry import ActionResult
from dextera_build.store.store import Store
from dextera_build.workers.admission import Admission, estimate, lacks
from dextera_build.workers.capacity import Capacity
from dextera_build.workers.protocol import Ended, Executor, Report, Said, Task, redacted

_PATIENCE_S = 0.02
"""Polling interval for keys that another process builds [s]."""
_REST_S = 0.1
"""Polling interval for nodes that wait for a retry [s]."""


@dataclass
class Dispatch:
    """Starts queued nodes and handles their reports."""

    store: Store
    executor: Executor | None
    states: States
    sharing: Sharing
    policy: RunPolicy
    reading: Reading
    listen: Listener
    pause: Callable[[], None]
    """Called before every wait."""
    history: History | None
    """Duration and peak memory of each node's previous run."""
    forced: Callable[[Node], bool]

    def __post_init__(self) -> None:
        self._running: dict[int, Node] = {}
        self._tickets = itertools.count()
        self._resting: list[Node] = []
        self._admission: Admission[Node] = Admission(self.executor.capacity if self.executor else Capacity())
        self._store_name = str(self.store.root)

    def start(self) -> Iterator[End]:
        """Start queued nodes while any of them fits; yields those that end without running."""
        if self.executor is None:
            return
        yield from self._line_up()
        while (node := self._admission.next()) is not None:
            hit = self._claim(node)
            if hit is None and node.state is State.QUEUED:
                node.ticket, node.tries = next(self._tickets), node.tries + 1
                self._running[node.ticket] = node
                self.states.set(node, State.RUNNING)
                self._tell_started(node)
                self.executor.submit(self._task(node, self._admission.devices(node)))
                continue
            self._admission.end(node)
            if hit is not None:
                yield End(node, "cached", hit)

    def _line_up(self) -> Iterator[End]:
        """Pass queued nodes to admission; nodes that wait for a retry follow once their delay is over."""
        queue, now = self.states.queue, time.monotonic()
        if self._resting:
            queue.extend(node for node in self._resting if node.rests_until <= now)
            self._resting = [node for node in self._resting if node.rests_until > now]
        while queue:
            node = queue.popleft()
            needs = node.rule.needs
            if node.rests_until > now:
                self._resting.append(node)
            elif lacking := needs.lacks(self._admission.capacity):
                yield End(node, error=lacks(lacking))
            else:
                peak_gb = self.history.peak_gb(node.address) if self.history else None
                self._admission.wait(node, estimate(needs, peak_gb))

    @property
    def is_busy(self) -> bool:
        """Whether a node runs, here or elsewhere, is being fetched, or waits for a retry."""
        return bool(self._running or self._resting or self.states.locked or self.states.fetching)

    def wait(self, idle: bool) -> Iterator[End]:
        """Handle the executor's reports, waiting for one if `idle`; yields the nodes that ended."""
        self.pause()
        busy = self.states.locked or self.states.fetching
        patience = 0.0 if not idle else _PATIENCE_S if busy else _REST_S if self._resting else None
        if self._running and self.executor is not None:
            for report in self.executor.poll(patience):
                end = self._take(redacted(report))
                if end is not None:
                    yield end
        elif self.states.fetching:
            self.sharing.wait(patience or 0.0)
        elif patience:
            time.sleep(patience)

    def retry_locked(self) -> Iterator[End]:
        """Check the keys that other processes were building; yields the nodes whose results are there."""
        for node in list(self.states.locked):
            assert node.key is not None
            hit = self.reading.whole(node)
            if hit is not None:
                yield End(node, "cached", hit)
            elif self.store.locks.take(node.key):
                self.store.locks.release(node.key)
                self.states.set(node, State.QUEUED)

    def release_all(self) -> None:
        """Release the locks of all running nodes when a run is cut short."""
        for node in self._running.values():
            self.store.locks.release(node.key or "")

    def _claim(self, node: Node) -> ActionResult | None:
        """Lock the node's key, or mark the node as locked; returns a result another process made in the meantime."""
        while True:
            key = node.key
            assert key is not None
            if not self.store.locks.take(key):
                self._log(node, "another process builds the same key")
                self.states.set(node, State.LOCKED)
                return None
            forced = self.forced(node)
            hit = None if forced or self.reading.is_missing(node) else self.reading.whole(node)
            if hit is None and node.key == key:
                if forced:
                    self.store.keep.drop(key)
                return None
            self.store.locks.release(key)
            if hit is not None:
                return hit
            # Another process ran it with other files; the key of our files has a lock of its own.

    def _task(self, node: Node, devices: tuple[str, ...]) -> Task:
        return node.rule.task(
            node.call.options,
            node.inputs,
            ticket=node.ticket,
            store=self._store_name,
            project=self.policy.project,
            profile=self.policy.profile,
            devices=devices,
            key=node.key or "",
        )

    def _take(self, report: Report) -> End | None:
        """How the node of a report ended, or None if it is still running."""
        node = self._running.get(report.ticket)
        if node is None:
            return None
        if isinstance(report, Said):
            self._hear(node, report)
            return None
        del self._running[report.ticket]
        self._admission.end(node)
        node.ticket = -1
        key = node.key or ""  # the discovered inputs change it
        try:
            return self._end(node, report)
        finally:
            self.store.locks.release(key)

    def _end(self, node: Node, report: Ended) -> End | None:
        node.last = replace(report, log=b"")
        retries = node.rule.retries
        if report.error is not None and retries.again(node.tries, report.error, report.raised):
            self._rest(node, report, report.error)
            return None
        try:
            result = publish(self.store, node, report, self.reading)
        except DxbError as error:
            error.where = node.call.placed(error.where, self.policy.project)
            return End(node, error=error)
        if report.reply is not None and report.reply["output"] != result.output:
            self._log(node, "its key gave another output before, which is kept: `dxb ls divergent`")
        return End(node, "ran", result)

    def _rest(self, node: Node, report: Ended, error: DxbError) -> None:
        """Schedule a retry of the node."""
        # Jitter from the node's key keeps nodes that failed together from being retried together.
        wait_s = backoff(node.tries, node.rule.retries.wait_s, node.key or "")
        node.rests_until = time.monotonic() + wait_s
        log = log_of(self.store, report)
        self.listen(events.NodeRetried(time.time(), node.address, node.tries, wait_s, error.to_json(), log))
        self.states.set(node, State.QUEUED)

    def _hear(self, node: Node, said: Said) -> None:
        data = said.data
        if said.kind == "read":
            self.reading.watch(node, data.get("steps"))
        elif said.kind == "progress":
            done, total, what = int(data["done"]), int(data["total"]), str(data.get("what", ""))
            self.listen(events.NodeProgress(time.time(), node.address, done, total, what))
        elif said.kind == "log":
            self._log(node, str(data["text"]))
        elif said.kind == "paid":
            self.listen(events.NodePaid(time.time(), node.address, **data))

    def _log(self, node: Node, text: str) -> None:
        self.listen(events.NodeLog(time.time(), node.address, text))

    def _tell_started(self, node: Node) -> None:
        rule, last = node.rule, self.history.get(node.address) if self.history else None
        seconds = last.seconds if last else None
        self.listen(events.NodeStarted(time.time(), node.address, rule.path, rule.backend, node.key or "", seconds))

"""Between the queue and the executor: locks, tasks, and what becomes of them."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

from dextera_build.engine.discovered import Reading
from dextera_build.engine.graph import RuleFacts
from dextera_build.engine.policy import Hooks, Policy
from dextera_build.engine.publish import log_of, publish
from dextera_build.engine.remote_results import Sharing
from dextera_build.engine.states import State
from dextera_build.engine.units import End, Node, UnitStates
from dextera_build.errors import DxbError
from dextera_build.store.entry import ActionResult
from dextera_build.store.store import Store
from dextera_build.workers.admission import Admission, estimate, lacks
from dextera_build.workers.capacity import Capacity, Needs
from dextera_build.workers.protocol import Ended, Executor, Report, Said, Task

_PATIENCE_S = 0.02
"""How often a key is looked at that another process builds [s]."""
_REST_S = 0.1
"""How often nodes are looked at that rest before another try [s]."""


@dataclass
class Dispatch:
    """Starts queued nodes and takes what comes back."""

    store: Store
    executor: Executor | None
    states: UnitStates
    sharing: Sharing
    policy: Policy
    reading: Reading
    hooks: Hooks
    forced: Callable[[Node], bool]

    def __post_init__(self) -> None:
        self._running: dict[int, Node] = {}
        self._tickets = itertools.count()
        self._resting: list[Node] = []
        self._admission: Admission[Node] = Admission(self.executor.capacity if self.executor else Capacity())
        self._needs: dict[int, tuple[RuleFacts, Needs, Mapping[str, tuple[float, float]]]] = {}
        """By identity, since rules cannot be hashed; an entry keeps its rule alive."""
        self._store_name = str(self.store.root)

    def start(self) -> Iterator[End]:
        """Start queued nodes as long as there is room for one of them; gives those that end without running."""
        if self.executor is None:
            return
        yield from self._line_up()
        while (node := self._admission.next()) is not None:
            hit = self._claim(node)
            if hit is None and node.state is State.QUEUED:
                node.ticket, node.tries = next(self._tickets), node.tries + 1
                self._running[node.ticket] = node
                self.states.set(node, State.RUNNING)
                self.hooks.started(node)
                self.executor.submit(self._task(node, self._admission.devices(node)))
                continue
            self._admission.end(node)
            if hit is not None:
                yield End(node, "cached", hit)

    def _line_up(self) -> Iterator[End]:
        """Let queued nodes stand in line for what they need; those that rest before another try do so later."""
        queue, now = self.states.queue, time.monotonic()
        if self._resting:
            queue.extend(node for node in self._resting if node.rests_until <= now)
            self._resting = [node for node in self._resting if node.rests_until > now]
        while queue:
            node = queue.popleft()
            needs, lacking = self._needs_of(node.rule)
            if node.rests_until > now:
                self._resting.append(node)
            elif lacking:
                yield End(node, error=lacks(lacking))
            else:
                self._admission.wait(node, estimate(needs, self.policy.peak_gb(node.address)))

    def _needs_of(self, rule: RuleFacts) -> tuple[Needs, Mapping[str, tuple[float, float]]]:
        """What calls of a rule need, and what of that is nowhere here."""
        known = self._needs.get(id(rule))
        if known is None:
            needs = rule.needs
            known = self._needs[id(rule)] = (rule, needs, needs.lacks(self._admission.capacity))
        return known[1:]

    @property
    def is_busy(self) -> bool:
        """Whether something runs, here or elsewhere, or rests before another try."""
        return bool(self._running or self._resting or self.states.locked or self.states.fetching)

    def wait(self, idle: bool) -> Iterator[End]:
        """Take what the executor reports, waiting for it where `idle`; gives the nodes that ended."""
        self.hooks.pause()
        busy = self.states.locked or self.states.fetching
        patience = 0.0 if not idle else _PATIENCE_S if busy else _REST_S if self._resting else None
        if self._running and self.executor is not None:
            for report in self.executor.poll(patience):
                end = self._take(report)
                if end is not None:
                    yield end
        elif self.states.fetching:
            self.sharing.wait(patience or 0.0)
        elif patience:
            time.sleep(patience)

    def retry_locked(self) -> Iterator[End]:
        """Look again at what other processes were building; gives what they have built."""
        for node in list(self.states.locked):
            assert node.key is not None
            hit = self.reading.whole(node)
            if hit is not None:
                yield End(node, "cached", hit)
            elif self.store.locks.take(node.key):
                self.store.locks.release(node.key)
                self.states.set(node, State.QUEUED)

    def release_all(self) -> None:
        """Let other processes build what runs here; for a run that is cut short."""
        for node in self._running.values():
            self.store.locks.release(node.key or "")

    def _claim(self, node: Node) -> ActionResult | None:
        """Take the lock of the node's key, or wait for who has it; returns what another process made meanwhile."""
        while True:
            key = node.key
            assert key is not None
            if not self.store.locks.take(key):
                self.hooks.said(node, "log", {"text": "another process builds the same key"})
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
            # Another process ran it with other files: what ours lead to has a lock of its own.

    def _task(self, node: Node, devices: tuple[str, ...]) -> Task:
        rule = node.rule
        return Task(
            ticket=node.ticket,
            rule=rule.path,
            backend=rule.backend,
            options=node.call.options,
            inputs=node.inputs,
            store=self._store_name,
            project=self.policy.project,
            profile=self.policy.profile,
            needs=self._needs_of(rule)[0],
            devices=devices,
            key=node.key or "",
            sources=rule.sources,
            packages=rule.packages,
        )

    def _take(self, report: Report) -> End | None:
        """What became of the node of a report, None where it goes on."""
        node = self._running.get(report.ticket)
        if node is None:
            return None
        if isinstance(report, Said):
            if report.kind == "read":
                self.reading.watch(node, report.data.get("steps"))
            else:
                self.hooks.said(node, report.kind, report.data)
            return None
        del self._running[report.ticket]
        self._admission.end(node)
        node.ticket = -1
        key = node.key or ""  # what the node read gives it another
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
            return End(node, error=error)
        if report.reply is not None and report.reply["output"] != result.output:
            text = "its key gave another output before, which is kept: `dxb ls divergent`"
            self.hooks.said(node, "log", {"text": text})
        return End(node, "ran", result)

    def _rest(self, node: Node, report: Ended, error: DxbError) -> None:
        """Have the node tried again after a while."""
        wait_s = node.rule.retries.delay_s(node.tries, node.key or "")
        node.rests_until = time.monotonic() + wait_s
        log = log_of(self.store, report)
        self.hooks.said(node, "retried", {"tries": node.tries, "wait_s": wait_s, "error": error.to_json(), "log": log})
        self.states.set(node, State.QUEUED)

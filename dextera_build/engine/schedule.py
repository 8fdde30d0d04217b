"""A suspending scheduler with constructive traces.

A node waits until the digests of all its inputs are known. Then it has a key: a result under that key is taken from the
store, otherwise the node runs. Its readers depend on the output's digest, so a node that ran again and produced the
same bytes leaves its readers cached (early cutoff).

A result may be bare: its digest is known, but its bytes are absent. That is enough until a node that must run reads
them; the reader then goes back to waiting until the bytes have been fetched or rebuilt.

The loop, until nothing is left to do:
- connect new units, and settle those that are ready: open groups, gather collections, look up keys;
- fill the executor from the queue;
- handle reports of the executor and of remotes; finished nodes release their readers;
- check the keys that other processes were building.

All graph walks are iterative, because chains may be long.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress

from dextera_build import digest as digests
from dextera_build.engine import blocking, rewind
from dextera_build.engine.discovered import Reading
from dextera_build.engine.dispatch import Dispatch
from dextera_build.engine.expand import Wiring
from dextera_build.engine.graph import Address, Graph
from dextera_build.engine.key import Writer
from dextera_build.engine.policy import RunPolicy
from dextera_build.engine.records import record_of, record_of_group
from dextera_build.engine.remote_results import Remotes, Sharing
from dextera_build.engine.states import LOST, State
from dextera_build.engine.units import End, Gathering, Node, Opening, States, Unit
from dextera_build.errors import DxbError, StaleError, StoreError
from dextera_build.runs import events
from dextera_build.runs.events import Listener, Status
from dextera_build.runs.history import Entry, History
from dextera_build.store.blobs import MissingBlob
from dextera_build.store.entry import ActionResult
from dextera_build.store.store import Store
from dextera_build.workers.protocol import Executor

_BATCH = 64


class Scheduler:
    """One run over one graph.

    Args:
        graph: The plan.
        store: Holds cached results and takes new ones.
        executor: Runs nodes; None only for a dry run.
        policy: Settings of the run.
        listen: Takes every event.
        history: Previous runs of the nodes; a dry run adds nothing.
        exchange: The remotes, if any.
        pause: Called after all pending events, before every wait.
    """

    def __init__(
        self,
        graph: Graph,
        store: Store,
        executor: Executor | None,
        policy: RunPolicy,
        *,
        listen: Listener = lambda event: None,
        history: History | None = None,
        exchange: Remotes = None,
        pause: Callable[[], None] = lambda: None,
    ) -> None:
        self.graph = graph
        self.store = store
        self.policy = policy
        self.listen = listen
        self.history = history
        self.states = States()
        self.wiring = Wiring(graph, store)
        self.failed: list[Unit] = []
        self.errors: list[DxbError] = []
        self._writer = Writer()
        self.reading = Reading(store, self._writer)
        self.sharing = Sharing(exchange, self.states, self.reading, listen)
        self.dispatch = Dispatch(
            store=store,
            executor=executor,
            states=self.states,
            sharing=self.sharing,
            policy=policy,
            reading=self.reading,
            listen=listen,
            pause=pause,
            history=history,
            forced=self._is_forced,
        )
        self._owners: dict[str, Node] = {}
        self._made: set[str] = set()
        """Keys that ran in a forced build: of two nodes with the same key, only one runs."""
        self._measured = (0, 0)
        self._any_bare = False
        self._is_broken = False
        """Whether anything failed that stops the run."""
        self.is_partial = False
        """Whether anything failed without which the run goes on, and which fails it at its end."""

    @property
    def stopping(self) -> bool:
        """Whether no new node may start."""
        return self._is_broken and not self.policy.keep_going

    def run(self, targets: Sequence[Address]) -> None:
        """Bring `targets` up to date, as far as possible.

        Raises:
            AssertionError: Nodes wait for one another in a cycle.
        """
        self.wiring.ask(targets)
        while True:
            more = self._settle()
            self._measure()
            if not self.stopping:
                self._take(self.dispatch.start())
            idle = self.stopping or not (more or self.states.ready)
            if idle and not self.dispatch.is_busy:
                break
            self._take(self.dispatch.wait(idle))
            if self.stopping and not self.states.running:
                break
            self._take(self.sharing.settle())
            self._take(self.dispatch.retry_locked())
        self._forbid_circles()

    def _take(self, ends: Iterable[End]) -> None:
        """Settle nodes that ended, and queue those that no remote has."""
        for end in ends:
            if end.error is not None:
                self._broke(end.node, end.error)
            elif end.result is not None and end.status is not None:
                self._succeed(end.node, end.status, end.result, bare=end.bare)
            else:
                self._queue(end.node)

    def _settle(self) -> bool:
        """Connect and settle a batch of units; returns whether more are left.

        Batches keep workers busy: the first nodes of a large graph run while others are still being connected.
        """
        for _ in range(_BATCH):
            while self.wiring.fresh:
                self._connect(self.wiring.fresh.popleft())
                if not self.stopping:  # when stopping, only connect, so that readers of failed units become blocked
                    break
            unit = None if self.stopping else self.states.next_ready()
            if unit is None and not self.wiring.fresh:
                return False
            if unit is None:
                continue
            try:
                if isinstance(unit, Node):
                    self._look_up(unit)
                elif isinstance(unit, Opening):
                    self._open(unit)
                elif isinstance(unit, Gathering):
                    self._gather(unit)
            except DxbError as error:
                self._broke(unit, error)
        return True

    def _measure(self) -> None:
        """Report the number of nodes if it changed; less often while a large graph is being connected."""
        openings = self.wiring.openings
        known = (len(self.wiring.nodes), len(openings))
        if known != self._measured and not (self.wiring.fresh and known[0] < 2 * self._measured[0]):
            self._measured = known
            unopened = sum(unit.state is not State.DONE and unit.state not in LOST for unit in openings.values())
            self.listen(events.RunSized(time.time(), known[0], unopened))

    def _connect(self, unit: Unit) -> None:
        try:
            self.wiring.connect(unit)
        except DxbError as error:
            self._fail(unit, error)
            return
        if not blocking.can_do_without(unit, unit.sources, self.graph):
            self._block(unit)
        elif unit.pending == 0:
            self.states.set(unit, State.READY)

    def _look_up(self, node: Node) -> None:
        call = node.call
        if node.leaves:
            self.wiring.note_leaves(node, call)  # another node may have refreshed their digests since
        inputs = node.inputs = self.wiring.values(node)
        document = node.document = self._writer.document(call, inputs)
        node.key = digests.of_bytes(document)
        try:
            self._find(node)
        finally:
            node.document = b""  # rebuilt after the node ran, because thousands of nodes may wait

    def _find(self, node: Node) -> None:
        """Take a node's result from the store, or request, queue or share it."""
        key = node.key
        assert key is not None
        owner = self._owners.get(key)
        if owner is not None:
            owner.followers.append(node)
            self.states.set(node, State.SHARED)
            return
        node.asked |= self.policy.whole
        node.owned = key
        hit = self.reading.find(node)
        forced = self._is_forced(node)
        # A dry run continues from a known result even if its bytes are absent.
        if hit is not None and not forced and (hit.is_whole or not node.asked or self.policy.dry):
            if not (hit.is_whole or self.policy.dry):
                self._note_bare(node, hit.result)
            self._succeed(node, "cached", hit.result, bare=not hit.is_whole)
        elif self.policy.dry:
            self.states.set(node, State.STALE)
        else:
            if hit is not None and not forced and node.output is None:
                self._tell_missed(node, node)
            self._owners[node.owned] = node
            # A forced node must run here, so remotes are not asked.
            if forced or not self.sharing.ask(node):
                self._queue(node)
        if self.policy.dry and (node.state is State.STALE or (node.bare and node.asked)):
            self._ask_above(node)

    def _note_bare(self, node: Node, result: ActionResult) -> None:
        """Record that the entry may lack bytes from now on."""
        with suppress(StoreError):  # a read-only store stays as it is
            self.store.actions.put(node.key or "", result, may_lack=True)

    def _ask_above(self, node: Node) -> None:
        """In a dry run, mark the results whose bytes `node` would need to run."""
        stack = [node]
        while stack and self._any_bare:
            for source in rewind.absent(stack.pop(), self.store, self.wiring):
                if not source.asked:
                    source.asked = True
                    stack.append(source)

    def _queue(self, node: Node) -> None:
        if self.policy.only is None or _named(node, self.policy.only):
            if not self._send_back(node, rewind.absent(node, self.store, self.wiring) if self._any_bare else []):
                self.states.set(node, State.QUEUED)
            return
        hint = f"dxb why '{self.graph.name}:{node.address}'"
        error = StaleError(f"`{node.address}` is stale and may not run now", code="DXB-C101", hint=hint)
        self._fail(node, error)

    def _send_back(self, unit: Unit, missing: Sequence[Node]) -> bool:
        """Let `unit` wait until the `missing` nodes have their bytes; False if there are none."""
        for node in missing:
            if node.state is State.DONE:
                self._tell_missed(node, node if node.asked else unit)
            node.asked = True
        if missing:
            self._connect_again(rewind.send_back(unit, missing, self.states))
        return bool(missing)

    def _connect_again(self, units: Sequence[Unit]) -> None:
        for unit in units:
            if isinstance(unit, Node):
                for follower in self._disown(unit):
                    self.states.set(follower, State.READY)
        self.wiring.fresh += units

    def _open(self, unit: Opening) -> None:
        unit.items = self.wiring.items(unit)
        self.listen(events.GroupOpened(time.time(), unit.address, list(unit.items)))
        self._measured = (0, 0)
        self._done(unit)

    def _gather(self, unit: Gathering) -> None:
        if unit.collect:
            unit.output = self.wiring.collection(unit)
        elif not self.policy.dry and self._send_back(unit, [node for node in unit.nodes.values() if node.bare]):
            return
        self._done(unit)

    def _succeed(self, node: Node, status: Status, result: ActionResult, *, bare: bool = False) -> None:
        node.result, node.status, node.error, node.bare = result, status, None, bare
        self._any_bare |= bare
        if status == "ran" and (self.policy.force or self.policy.recall):
            self._made |= {node.owned, node.key or ""}
        node.document = b""
        followers = self._disown(node)
        self.sharing.offer(node)
        self._done(node)
        for follower in followers:
            follower.key, follower.reads = node.key, node.reads
            self._succeed(follower, "cached", result, bare=bare)

    def _disown(self, node: Node) -> list[Node]:
        """Give up the node's claim to its key; returns the followers that waited for it."""
        if self._owners.get(node.owned) is node:
            del self._owners[node.owned]
        return node.let_go()

    def _done(self, unit: Unit) -> None:
        self.states.set(unit, State.DONE)
        if isinstance(unit, Node):
            self._tell_settled(unit)
        for dependent in unit.release():
            if dependent.state is State.WAITS:
                dependent.pending -= 1
                self._come_nearer(dependent, unit)
            elif isinstance(dependent, Gathering) and isinstance(unit, Opening):
                # The gathering has failed or is blocked, but single copies in this group may still be built.
                self.wiring.expand(dependent, unit)

    def _come_nearer(self, dependent: Unit, source: Unit) -> None:
        if isinstance(dependent, Gathering) and isinstance(source, Opening):
            known = len(dependent.sources)
            try:
                self.wiring.expand(dependent, source)
            except DxbError as error:
                self._fail(dependent, error)
                return
            if not blocking.can_do_without(dependent, dependent.sources[known:], self.graph):
                self._block(dependent)
                return
        if dependent.pending == 0:
            self.states.set(dependent, State.READY)

    def _broke(self, unit: Unit, error: DxbError) -> None:
        """Handle an error of `unit`: recover missing input bytes if possible, otherwise fail."""
        lost = error.facts.get("digest") if error.code == MissingBlob.CODE else None
        again = rewind.rewind(unit, lost, self.store, self.states) if lost else None
        if again is None:
            self._fail(unit, error)
            return
        for other in again:
            if isinstance(other, Node):
                other.asked |= other is not unit
                self.wiring.forget_leaves(other)
                self.reading.forget(other)
        self._connect_again(again)

    def _fail(self, unit: Unit, error: DxbError) -> None:
        self.states.set(unit, State.FAILED)
        self.failed.append(unit)
        self.errors.append(error)
        effect = blocking.consequence(unit, self.graph)
        self._is_broken, self.is_partial = self._is_broken or effect == "stop", self.is_partial or effect == "go_on"
        if isinstance(unit, Node):
            unit.error, unit.status = error, "failed"
            followers = self._disown(unit)
            self._tell_settled(unit)
            for follower in followers:
                if error.code == "DXB-B304":  # a file of the other node changed; this one may read a different file
                    self.states.set(follower, State.READY)
                else:
                    self._fail(follower, error)
        else:
            self.listen(record_of_group(unit, error))
        blocking.block_readers(unit, self.graph, self.states)

    def _block(self, unit: Unit) -> None:
        self.states.set(unit, State.BLOCKED)
        blocking.block_readers(unit, self.graph, self.states)

    def _tell_missed(self, node: Node, reader: Unit) -> None:
        self.listen(events.BytesMissed(time.time(), node.address, reader.address))

    def _tell_settled(self, node: Node) -> None:
        """Report a settled node, and record it in the history."""
        if self.policy.dry:
            return
        record, result = record_of(node, self.policy.project), node.result
        if self.history is not None and result is not None and record.result is not None and record.key is not None:
            # The duration of a fetch does not predict that of a run.
            entry = Entry(record.key, result.key_document, self.policy.run, result.seconds, record.time, record.usage)
            self.history.note(node.address, entry)
        self.listen(record)

    def _is_forced(self, node: Node) -> bool:
        if node.status or node.key in self._made or not (self.policy.force or self.policy.recall):
            return False
        known = self.store.actions.known(node.key or "") if self.policy.recall else None
        return _named(node, self.policy.force) or (known is not None and bool(known.calls))

    def _forbid_circles(self) -> None:
        if self.failed or self.policy.dry:
            return
        stuck = sorted(node.address for node in self.wiring.nodes.values() if node.state is State.WAITS)
        if stuck:
            raise AssertionError(f"these nodes wait for one another: {', '.join(stuck[:12])}")


def _named(node: Node, names: frozenset[str]) -> bool:
    return node.address in names or ".".join(node.path) in names

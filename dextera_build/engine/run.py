"""One build, from targets to a result: runs the scheduler, turns what happens into events, and remembers it."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from dextera_build.engine.graph import Address, Graph
from dextera_build.engine.lookup import leaves_of, walk
from dextera_build.engine.policy import Hooks, Policy
from dextera_build.engine.records import RunResult as RunResult
from dextera_build.engine.records import record_of, record_of_group
from dextera_build.engine.remote_results import Remotes
from dextera_build.engine.schedule import Scheduler
from dextera_build.engine.states import State
from dextera_build.engine.units import Node, Opening, Unit
from dextera_build.engine.uplink import Uplink
from dextera_build.errors import DxbError
from dextera_build.runs import events
from dextera_build.runs.events import Listener, NodeFinished
from dextera_build.runs.history import Entry, History
from dextera_build.store.store import Store
from dextera_build.workers.protocol import Executor


@dataclass(frozen=True)
class RunInfo:
    """What is said of a run and does not change what it makes."""

    run: str = ""
    """Id of the run, `0143`."""
    project: str = ""
    """Folder of the project; workers get it."""
    profile: str = ""
    dxb: str = ""
    """Version of dxb."""
    argv: tuple[str, ...] = ()
    variant: str = ""
    """What tells the request from the recipe's own; see `Session.variant`."""


def build(  # noqa: PLR0913 - the whole interface of the engine
    graph: Graph,
    targets: Sequence[Address | tuple[str, ...]],
    *,
    store: Store,
    executor: Executor,
    listen: Listener,
    info: RunInfo | None = None,
    keep_going: bool = False,
    force: frozenset[str] = frozenset(),
    only: frozenset[str] | None = None,
    exchange: Remotes = None,
    recall: bool = False,
    whole: bool = False,
    pause: Callable[[], None] = lambda: None,
) -> RunResult:
    """Bring targets up to date.

    Args:
        graph: The plan.
        targets: What to build; a tuple names every copy of a call.
        store: Where results come from and go to.
        executor: What runs nodes; the caller closes it.
        listen: Takes every event.
        info: What is said of the run.
        keep_going: After a failure go on with everything that does not depend on it.
        force: Addresses (`body[mug].mesh`, or `body.mesh` for every copy) that run although they are cached.
        only: Addresses that may run; a stale node outside fails with a `StaleError`. None: all may.
        exchange: Remotes to take results from and to give them to; closed here.
        recall: Nodes whose results came of recorded calls run although they are cached.
        whole: Bring or make the bytes of all nodes, also of those that nobody has to read.
        pause: Called when all that there is to tell was told, before time passes.

    Raises:
        UsageError: A target names nothing.
        RecipeError: A file or folder that the targets need is missing or cannot be read; nothing ran.
        KeyboardInterrupt: The run was interrupted; what was finished by then is kept.
    """
    wanted = [target if isinstance(target, Address) else Address(target) for target in targets]
    info = info or RunInfo()
    policy = Policy(keep_going, force, only, recall, whole, project=info.project, profile=info.profile)
    with store.running.announced():
        return _Run(graph, store, executor, policy, Uplink(exchange, listen, pause), info).run(wanted)


class _Run:
    def __init__(
        self, graph: Graph, store: Store, executor: Executor, policy: Policy, uplink: Uplink, info: RunInfo
    ) -> None:
        self.graph, self.store, self.executor, self.uplink, self.info = graph, store, executor, uplink, info
        self.listen = uplink.listen
        self.history = History(store, graph.name, info.project, info.variant)
        hooks = Hooks(self._sized, self._opened, self._missed, self._started, self._said, self._settled, self._broken)
        hooks.pause = uplink.pause
        policy = replace(policy, peak_gb=self.history.peak_gb)
        self.scheduler = Scheduler(graph, store, executor, policy, hooks, uplink.exchange)
        self.records: dict[str, NodeFinished] = {}
        self.errors: dict[str, DxbError] = {}
        self.members: Counter[tuple[str, ...]] = Counter()
        """Group, or () for the root -> how many of its calls the targets need."""

    def run(self, targets: list[Address]) -> RunResult:
        for path, calls in walk(self.graph, targets):
            self.members[path[:-1]] += 1
            # What is missing is said before an hour of work, not after.
            for leaf in leaves_of(calls):
                self.scheduler.wiring.leaf(leaf)
        began = time.monotonic()
        self._announce(targets)
        interrupted = whole = False
        try:
            self.scheduler.run(targets)
            whole = True
            self.uplink.finish()
        except KeyboardInterrupt:
            interrupted = True
            self.executor.stop()
            raise
        except BaseException:
            self.executor.stop()
            raise
        finally:
            self.uplink.close()
            result = self._close(whole)
            self._finish(result, time.monotonic() - began, interrupted)
        return result

    def _announce(self, targets: list[Address]) -> None:
        groups = len({path[:depth] for path in self.members for depth in range(1, len(path) + 1)})
        self.listen(
            events.RunStarted(
                time=time.time(),
                run=self.info.run,
                recipe=self.graph.name,
                targets=[str(target) for target in targets],
                profile=self.info.profile,
                dxb=self.info.dxb,
                calls=self.members.total(),
                groups=groups,
                argv=list(self.info.argv),
                variant=self.info.variant,
            )
        )

    def _sized(self, nodes: int, unopened: int) -> None:
        self.listen(events.RunSized(time.time(), nodes, unopened))

    def _opened(self, unit: Opening) -> None:
        labels = list(unit.items)
        self.listen(events.GroupOpened(time.time(), unit.address, labels, self.members[unit.path] * len(labels)))

    def _missed(self, node: Node, reader: Unit) -> None:
        self.listen(events.BytesMissed(time.time(), node.address, reader.address))

    def _started(self, node: Node) -> None:
        rule, last = node.rule, self.history.get(node.address)
        seconds = last.seconds if last else None
        self.listen(events.NodeStarted(time.time(), node.address, rule.path, rule.backend, node.key or "", seconds))

    def _said(self, node: Node, kind: str, data: Any) -> None:
        if kind == "progress":
            what = str(data.get("what", ""))
            self.listen(events.NodeProgress(time.time(), node.address, int(data["done"]), int(data["total"]), what))
        elif kind == "log":
            self.listen(events.NodeLog(time.time(), node.address, str(data["text"])))
        elif kind == "retried":
            self.listen(events.NodeRetried(time.time(), node.address, **data))

    def _settled(self, node: Node) -> None:
        record, result = record_of(node, self.info.project), node.result
        if record.result is not None and result is not None and record.key is not None:
            # How long a fetch took says nothing of how long the node runs.
            entry = Entry(record.key, result.key_document, self.info.run, result.seconds, record.time, record.usage)
            self.history.note(node.address, entry)
        self.uplink.tell()
        self._tell(record)

    def _broken(self, unit: Unit, error: DxbError) -> None:
        self.errors[unit.address] = error
        self.listen(record_of_group(unit, error))

    def _tell(self, record: NodeFinished) -> None:
        self.records[record.node] = record
        if record.error is not None:
            self.errors[record.node] = record.error
        self.listen(record)

    def _close(self, whole: bool) -> RunResult:
        """End every node that is still open, and say so."""
        scheduler = self.scheduler
        scheduler.dispatch.release_all()
        blockers = blocked_by(scheduler.failed)
        for node in scheduler.wiring.nodes.values():
            if node.state in (State.DONE, State.FAILED):
                continue
            if node.state is not State.BLOCKED:
                scheduler.states.set(node, State.CANCELLED)
            self._tell(record_of(node, self.info.project, blockers.get(node.address, ())))
        ok = whole and all(wish.state is State.DONE for wish in scheduler.wishes)
        asked = tuple(dict.fromkeys(scheduler.wiring.asked()))
        records = {address: self.records[address] for address in scheduler.wiring.nodes}
        return RunResult(ok, records, asked, self.info.run, scheduler.wiring, self.errors)

    def _finish(self, result: RunResult, seconds: float, interrupted: bool) -> None:
        self.history.save()
        self.store.leaves.save()
        counts: Counter[str] = Counter(record.status for record in result.nodes.values())
        spared = [node for node in self.scheduler.wiring.nodes.values() if node.status in ("cached", "fetched")]
        saved = sum((node.result.seconds if node.result else 0.0) - node.fetched_s for node in spared)
        self.listen(events.RunFinished(time.time(), result.ok, seconds, dict(counts), max(saved, 0.0), interrupted))


def blocked_by(failed: Sequence[Unit]) -> dict[str, list[str]]:
    """Node address -> addresses of the failed units that it waits for, directly or not."""
    found: dict[str, list[str]] = {}
    for root in failed:
        for unit in _readers(root):
            if isinstance(unit, Node):
                found.setdefault(unit.address, []).append(root.address)
    return found


def _readers(root: Unit) -> Iterator[Unit]:
    seen = {id(root)}
    stack = list(root.dependents)
    while stack:
        unit = stack.pop()
        if id(unit) not in seen:
            seen.add(id(unit))
            yield unit
            stack += unit.dependents

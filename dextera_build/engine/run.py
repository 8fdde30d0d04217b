"""One build, from targets to a result: announces the plan, runs the scheduler, and settles the remaining nodes."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from dextera_build.engine import missing
from dextera_build.engine.expand import Unmatched
from dextera_build.engine.graph import Address, Graph
from dextera_build.engine.policy import RunPolicy
from dextera_build.engine.records import record_of
from dextera_build.engine.remote_results import Remotes
from dextera_build.engine.schedule import Scheduler
from dextera_build.engine.states import State
from dextera_build.engine.units import Node, Unit
from dextera_build.errors import DxbError, interrupt_of
from dextera_build.runs import events, workspaces
from dextera_build.runs.events import Event, Listener, NodeFinished
from dextera_build.runs.history import History
from dextera_build.store.store import Store
from dextera_build.workers.protocol import Executor

_DEFAULT = RunPolicy()


@dataclass(frozen=True)
class RunResult:
    """The outcome of a run."""

    ok: bool
    """Whether every target is up to date, and nothing failed but copies that a group leaves out."""
    nodes: Mapping[str, NodeFinished]
    """Address -> record of the node, in the order in which the run reached them."""
    targets: tuple[str, ...]
    """Addresses of the requested nodes, one for each copy."""
    errors: Mapping[str, DxbError] = field(default_factory=dict)
    """Address of a failed node, group, collection or target -> its error."""
    unmatched: tuple[Unmatched, ...] = ()
    """Labels under `overrides:` that no copy has."""


def build(
    graph: Graph,
    targets: Sequence[Address | tuple[str, ...]],
    *,
    store: Store,
    executor: Executor,
    listen: Listener,
    policy: RunPolicy = _DEFAULT,
    exchange: Remotes = None,
    pause: Callable[[], None] = lambda: None,
) -> RunResult:
    """Bring targets up to date.

    Args:
        graph: The plan.
        targets: Nodes to build; a tuple names every copy of a call.
        store: Holds cached results and takes new ones.
        executor: Runs nodes; the caller closes it.
        listen: Takes every event.
        policy: Settings of the run.
        exchange: Remotes to download results from and upload them to; closed here.
        pause: Called after all pending events, before every wait.

    Raises:
        UsageError: A target does not exist.
        RecipeError: A file or folder that the targets need is missing or cannot be read; no node ran.
        MachineError: A backend that the targets need is missing; no node ran.
        KeyboardInterrupt: The run was interrupted; results finished by then are kept.
    """
    wanted = [target if isinstance(target, Address) else Address(target) for target in targets]
    records: dict[str, NodeFinished] = {}

    def take(event: Event) -> None:
        if isinstance(event, NodeFinished):
            records[event.node] = event
        listen(event)

    history = History(store, graph.name, policy.workspace, policy.variant)
    scheduler = Scheduler(graph, store, executor, policy, listen=take, history=history, exchange=exchange, pause=pause)
    with store.running.announced():
        _announce(scheduler, wanted)
        began = time.monotonic()
        interrupted = whole = False
        try:
            scheduler.run(wanted)
            whole = True
            scheduler.sharing.finish(pause)
        except BaseException as error:
            interrupted = interrupt_of(error) is not None
            executor.stop()
            raise
        finally:
            scheduler.sharing.close()
            result = _close(scheduler, records, whole)
            _finish(scheduler, result, time.monotonic() - began, interrupted)
    return result


def _announce(scheduler: Scheduler, targets: Sequence[Address]) -> None:
    """Announce the plan, after checking all files that it needs."""
    graph, policy = scheduler.graph, scheduler.policy
    calls = scheduler.wiring.look(targets)  # report missing files before an hour of work, not after
    chosen = {(call.rule.path, call.rule.chosen): call.rule for path in calls for call in graph.variants(path)}
    rules = [rule for _, rule in sorted(chosen.items())]
    missing.refuse(rules)
    groups = {path[:depth] for path in calls for depth in range(1, len(path))}
    scheduler.listen(
        events.RunStarted(
            time=time.time(),
            run=policy.run,
            recipe=graph.name,
            targets=[str(target) for target in targets],
            profile=policy.profile,
            dxb=policy.dxb,
            calls=len(calls),
            groups=len(groups),
            argv=list(policy.argv),
            variant=policy.variant,
            workspace=workspaces.mark(policy.workspace),
            backends={f"{rule.path}: {rule.backend}": rule.chosen for rule in rules if rule.backend},
            instead=[f"{rule.path} runs on {rule.backend} ({rule.chosen})" for rule in rules if rule.passed],
        )
    )


def _close(scheduler: Scheduler, records: Mapping[str, NodeFinished], whole: bool) -> RunResult:
    """Settle every node that is still open, and report it."""
    scheduler.dispatch.release_all()
    blockers = _blocked_by(scheduler.failed)
    nodes = scheduler.wiring.nodes
    for node in nodes.values():
        if node.state in (State.DONE, State.FAILED):
            continue
        node.status = "waits" if node.state is State.BLOCKED else "cancelled"
        if node.state is not State.BLOCKED:
            scheduler.states.set(node, State.CANCELLED)
        scheduler.listen(record_of(node, scheduler.policy.project, blockers.get(node.address, ())))
    done = whole and all(wish.state is State.DONE for wish in scheduler.wiring.wishes)
    asked = tuple(dict.fromkeys(scheduler.wiring.asked))
    errors = {address: record.error for address, record in records.items() if record.error is not None}
    return RunResult(
        done and not scheduler.is_partial,
        {address: records[address] for address in nodes},
        asked,
        errors,
        tuple(scheduler.wiring.unmatched()),
    )


def _finish(scheduler: Scheduler, result: RunResult, seconds: float, interrupted: bool) -> None:
    if scheduler.history is not None:
        scheduler.history.save(ok=result.ok)
    scheduler.store.leaves.save()
    counts: Counter[str] = Counter(record.status for record in result.nodes.values())
    spared = [node for node in scheduler.wiring.nodes.values() if node.status in ("cached", "fetched")]
    saved = sum((node.result.seconds if node.result else 0.0) - node.fetched_s for node in spared)
    scheduler.listen(events.RunFinished(time.time(), result.ok, seconds, dict(counts), max(saved, 0.0), interrupted))


def _blocked_by(failed: Sequence[Unit]) -> dict[str, list[str]]:
    """Node address -> addresses of the failed units that it waits for, directly or not."""
    found: dict[str, list[str]] = {}
    for root in failed:
        seen = {id(root)}
        stack = list(root.dependents)
        while stack:
            unit = stack.pop()
            if id(unit) in seen:
                continue
            seen.add(id(unit))
            stack += unit.dependents
            if isinstance(unit, Node):
                found.setdefault(unit.address, []).append(root.address)
    return found

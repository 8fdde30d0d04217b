"""One build, from a request to the files in `out/`; called by `dxb build`, `dxb watch`, `dxb pull` and Python."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from dextera_build import __version__
from dextera_build.building import fetch
from dextera_build.building.executors import executor
from dextera_build.building.export import Out, Placed
from dextera_build.errors import DxbError, StoreError, UsageError, did_you_mean, listing
from dextera_build.session import Session, addresses, warnings
from dextera_build.store import files

if TYPE_CHECKING:
    from dextera_build.building.lock import Locking
    from dextera_build.engine.dry import Planned
    from dextera_build.engine.expand import Unmatched
    from dextera_build.engine.graph import Address
    from dextera_build.engine.run import RunResult
    from dextera_build.recipe.plan import Plan
    from dextera_build.remotes.exchange import Exchange
    from dextera_build.runs.events import Listener
    from dextera_build.store.signature import Watch
    from dextera_build.store.store import Store
    from dextera_build.workers.protocol import Executor


@dataclass(frozen=True)
class Order:
    """The targets and flags of one build; see `engine.policy.RunPolicy`."""

    targets: Sequence[str] = ("",)
    """Names of targets or addresses of nodes; "" means the default targets."""
    keep_going: bool = False
    force: Sequence[str] = ()
    """Addresses of nodes that run even if cached."""
    whole: bool = False
    argv: Sequence[str] = ()
    bring_from: Exchange | None = None
    """Nothing runs: missing results, with all their bytes, come only from these remotes."""

    @property
    def forced(self) -> frozenset[str]:
        """`force` without names of recipes."""
        return frozenset(name.partition(":")[2] or name for name in self.force)


@dataclass(frozen=True)
class Built:
    """The outcome of an order."""

    result: RunResult
    """The outcome of every node."""
    run: str
    """Id of the run; "" if the store cannot be written."""
    lost: int
    """Number of events missing from the run's log because the disk was full."""
    placed: Placed = field(default_factory=Placed)
    """The targets exported to `out/`."""
    notice: str = ""
    """Changes of `dxb.lock`, in one line."""

    @property
    def ok(self) -> bool:
        """Whether every target is up to date."""
        return self.result.ok


def build(session: Session, order: Order, locking: Locking, listen: Listener, watch: Watch | None = None) -> Built:
    """Plan a recipe, run stale nodes, export the targets, and record the run.

    Args:
        session: The recipe with the additions of the request.
        order: The targets and flags.
        locking: Updates `dxb.lock`, or refuses builds that differ from it; written here.
        listen: Takes every event.
        watch: Collects the files that are read, even if the build fails, and the exported files.

    Raises:
        UsageError: A name does not exist.
        RecipeError: A recipe or an input is invalid.
        StaleError: A target differs from `dxb.lock`.
        MachineError: A chosen backend is not installed.
        StoreError: The disk is full, or a folder cannot be written.
    """
    store = session.store
    _name_missing_locks(store)
    store.leaves.watch = watch
    if watch is not None:
        from dextera_build.code.distributions import note_packages

        note_packages(watch)
    warm = not session.planning.recall(watch)  # planning takes as long as a worker needs to load
    # Protects the results from garbage collection until they are exported.
    with executor(session, idle=order.bring_from is not None, warm=warm) as ready, store.running.announced():
        plan = session.plan(watch=watch)
        wanted = [address for target in order.targets for address in addresses(plan.graph, target)]
        _refuse_unknown_force(order, plan)
        _refuse_unknown_copies(plan, wanted, session)
        locking.refuse(session, plan, wanted)
        build = _Build(session, order, plan, wanted, listen, ready(plan.rules))
        built = build.run()
        if built.ok:
            locking.refuse(session, plan, wanted)
        out = Out(session)
        with out.held():
            built = build.place(out, built)
            if not built.ok:
                return built
            locking.note(session, plan, wanted, built.result)
            if watch is not None:
                watch.present |= built.placed.present
            return replace(built, notice=locking.write())


def _name_missing_locks(store: Store) -> None:
    """Warn of a file system without locks."""
    if store.locks.are_missing():
        kind = files.file_system(str(store.local)) or "its file system"
        warnings[
            f"the file system of the store has no locks ({kind}, `{store.root}`): builds at once may run a node twice "
            "and lose the history, and a collection keeps what was used within a day"
        ] = None


def _says(one: Unmatched) -> str:
    """The warning of a label that no copy has."""
    known = did_you_mean(one.label, one.known) or f"the copies are {listing(one.known)}"
    return f"{one.where}: `overrides.{one.label}` changes nothing: `{one.group}` has no `{one.label}`; {known}"


@dataclass(frozen=True)
class _Build:
    session: Session
    order: Order
    plan: Plan
    wanted: Sequence[Address]
    listen: Listener
    executor: Executor

    def run(self) -> Built:
        """Run stale nodes, with the configured remotes and an event log."""
        from dextera_build.engine.policy import RunPolicy
        from dextera_build.engine.run import build
        from dextera_build.runs.events import fan_out
        from dextera_build.runs.log import EventLog

        session, order, project = self.session, self.order, self.session.project
        brings = order.bring_from is not None
        with EventLog(session.store) as log:
            policy = RunPolicy(
                keep_going=order.keep_going,
                force=order.forced,
                # When only downloading, no node may run.
                only=frozenset() if brings or project.remotes.local == "r" else None,
                recall=project.asks_again and not brings,
                whole=order.whole or brings,
                project=str(project.root),
                workspace=session.workspace,
                profile=project.profile,
                run=log.run,
                dxb=__version__,
                argv=tuple(order.argv),
                variant=session.variant,
            )
            result = build(
                self.plan.graph,
                self.wanted,
                store=session.store,
                executor=self.executor,
                listen=fan_out(log, self.listen),
                policy=policy,
                exchange=order.bring_from or fetch.usable(session),
                pause=log.flush,
            )
        for one in result.unmatched:
            warnings[_says(one)] = None
        if result.ok:
            session.note_built(session.variant)
        return Built(result, log.run, log.lost)

    def place(self, out: Out, built: Built) -> Built:
        """Export the targets; if a blob is damaged on disk, build once more."""
        from dextera_build.store.blobs import MissingBlob

        result = built.result
        try:
            placed = out.place(result, self._out_of_date(out, result) if built.ok else ())
        except StoreError as error:
            if error.code != MissingBlob.CODE:
                if any(failed.code == error.code for failed in result.errors.values()):
                    return built  # a node failed with the same error, already reported
                raise
            # Quarantine all damaged blobs, so that the next build recreates them.
            for node in result.targets:
                entry = self.session.store.actions.entry(result.nodes[node].key or "")
                for file in entry.files if entry else ():
                    self.session.store.blobs.verify(file.digest)
            built = self.run()
            placed = out.place(built.result)
        return replace(built, placed=placed)

    def _out_of_date(self, out: Out, result: RunResult) -> list[str]:
        """Nodes whose copies in `out/` are outdated: removed from the recipe, or built from an earlier capture."""
        others = {node: output for node, output in out.nodes().items() if node not in result.targets}
        if not others:
            return []
        from dextera_build.engine.dry import plan as dry
        from dextera_build.engine.graph import Address, parse_address

        # Files read here do not affect the answer.
        store, graph = self.session.store, self.plan.graph
        store.leaves.watch = None
        there = {call for call, _ in graph.calls()}
        calls = dict.fromkeys(call for node in others if (call := parse_address(node).call) in there)
        try:
            now = {node.address: node for node in dry(graph, [Address(call) for call in calls], store)}
        except DxbError:
            return []  # the next build of these nodes reports it
        return [node for node, output in others.items() if node not in now or not _makes(now[node], output)]


def _makes(node: Planned, output: str) -> bool:
    return node.output == output or node.bare


def _refuse_unknown_force(order: Order, plan: Plan) -> None:
    for name in order.force:
        try:
            addresses(plan.graph, name.partition(":")[2] or name)
        except UsageError as error:
            error.message = f"`--force {name}`: {error.message}"
            raise


def _refuse_unknown_copies(plan: Plan, wanted: Sequence[Address], session: Session) -> None:
    """Refuse settings for copies that groups do not have, before anything runs if the store knows the copies."""
    from dextera_build.engine.dry import survey
    from dextera_build.engine.graph import Group

    groups = [member for member in plan.graph.members.values() if isinstance(member, Group)]
    while groups:
        group = groups.pop()
        groups += [member for member in group.members.values() if isinstance(member, Group)]
        if group.named:
            survey(plan.graph, wanted, session.store)
            return

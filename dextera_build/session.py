"""A recipe of a project as used by verbs: plans it, and finds its targets and the results of past runs."""

from __future__ import annotations

import os
import re
from collections.abc import Container, Iterator, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any

from dextera_build import digest as digests
from dextera_build.errors import DxbError, RuleError, UsageError, did_you_mean, listing
from dextera_build.project.planning import Added, Planning, inputs_to_give, refuse_unknown
from dextera_build.project.project import LOCK, Project
from dextera_build.redact import redact
from dextera_build.runs.snapshot import LAST

# A no-op build loads none of these.
if TYPE_CHECKING:
    from dextera_build.artifacts.base import Artifact
    from dextera_build.engine.graph import Address, Graph
    from dextera_build.project.lockfile import Bindings
    from dextera_build.recipe.plan import Plan
    from dextera_build.runs.history import Entry, History
    from dextera_build.store.signature import Watch
    from dextera_build.store.store import Store


NO_BYTES = "its bytes are not in the store"
"""Text about a bare result."""
warnings: dict[str, None] = {}
"""Warnings from sessions of this process, printed by the command line."""
notices: dict[str, None] = {}
"""Lines about the request whose results a reading verb uses, printed by the command line."""


def reading(project: Project) -> Store:
    """The store of a project for a read-only verb; a missing folder is not created, but noted in `warnings`."""
    from dextera_build.store.store import Store

    store = Store(project.cache, make=False)
    if not store.root.is_dir():
        folder, origin = project.shown(store.root), project.config["cache"].origin
        warnings[f"there is no store at `{folder}` yet (from: {origin})"] = None
    return store


_BUILT = "built"
"""Kind of state rows: a request that was built successfully."""
_LONGEST = 40
"""Maximum length [characters] of the readable part of a variant's name."""


class Session:
    """One recipe of a project, as used by a verb.

    Args:
        project: The project.
        recipe: The recipe's address.
        added: Additions of the request.
        makes: Whether the verb builds, so that a missing store is created.
        last: If the request adds nothing, no flag sets a profile, and it was never built, answer for the last request
            that was built successfully, with a line in `notices`; a profile set in the environment must match it.
        node: The node that is read, perhaps with fields behind it; "" if the whole recipe is.
        names: Bindings to use instead of those of `dxb.lock`.
        variant: The request's `variant`, if a run says it.
    """

    def __init__(
        self,
        project: Project,
        recipe: str,
        added: Added | None = None,
        *,
        makes: bool = False,
        last: bool = False,
        node: str = "",
        names: Bindings | None = None,
        variant: str | None = None,
    ) -> None:
        self.project = project
        self.recipe = recipe
        self.added = added or Added()
        self._makes, self._last, self._node, self._names = makes, last, node, names
        self._variant = variant

    @cached_property
    def store(self) -> Store:
        """The project's store."""
        from dextera_build.store.store import Store

        return Store(self.project.cache) if self._makes else reading(self.project)

    @cached_property
    def names(self) -> Bindings:
        """The names that `dxb.lock` binds, in this recipe and in others."""
        if self._names is not None:
            return self._names
        lock = self.project.lock()
        return lock.names if lock is not None else {}

    @cached_property
    def workspace(self) -> str:
        """The project's name in the records of its store."""
        from dextera_build.project import workspace

        return workspace.workspace(self.project)

    @cached_property
    def variant(self) -> str:
        """Suffix that separates a request's files and history from the recipe's default: `@gpu-1a2b3c4d`, or ""."""
        if self._variant is not None:
            return self._variant
        project = self.project
        profile = project.profile if project.profile != project.own_profile else ""
        own = variant_of(profile, self.added)
        if not self._last or self.added or project.config["profile"].origin == "command line":
            return own
        last = self._built_last()
        if last == own or (profile and not last.startswith(f"@{profile}+")) or not self._is_answered_by(last, own):
            return own
        told = last[1:].rpartition("-")[0]
        needs = inputs_to_give(self.project, self.recipe)
        instead = "" if needs else f"; `dxb build {self.recipe}` builds it without"
        notices[f"`{self.recipe}` as built with {told}{instead}"] = None
        return last

    def _is_answered_by(self, last: str, own: str) -> bool:
        """Whether the request built last has the results to read, and the own one does not."""
        for variant in (own, last):
            if node_among(self._past(variant).all(), self._node):
                return variant == last
        built = self.store.state.some(_BUILT, [self._name_of(own), self._name_of(last)])
        return self._name_of(own) not in built and self._name_of(last) in built

    def note_built(self, variant: str) -> None:
        """Record that a request of the recipe was built successfully, and is the last one."""
        state, name = self.store.state, self._name_of(variant)
        if state.get(_BUILT, name) is None:
            state.put(_BUILT, {name: b""})
        if self._built_last() != variant:
            state.put(LAST, {self.last_name: variant.encode()})

    @cached_property
    def last_name(self) -> str:
        """Name of the store's record of the recipe's request built last."""
        return self._name_of()

    def _name_of(self, *variant: str) -> str:
        return digests.of_value([self.workspace, self.recipe, *variant])[:16]

    def _built_last(self) -> str:
        found = self.store.state.get(LAST, self.last_name)
        return found.decode(errors="replace") if found else ""

    @cached_property
    def planning(self) -> Planning:
        """Plans the request."""
        return Planning(self.project, self.recipe, self.added, self.names, reads=self._makes)

    def plan(self, *, incomplete: bool = False, watch: Watch | None = None) -> Plan:
        """Resolve the recipe with the additions of the request, or take the plan of an earlier command.

        Args:
            incomplete: Plan also without required inputs that are not given; `Plan.absent` names them.
            watch: Notes the files that planning reads.

        Raises:
            UsageError: There is no such recipe, or a required input is not given.
        """
        made, told = self.planning.plan(incomplete=incomplete, watch=watch)
        if self.project.console != "jsonl":
            warnings.update(dict.fromkeys(told))
            warnings.update(dict.fromkeys(self._unbound(made.graph)))
        return made

    def _unbound(self, graph: Graph) -> Iterator[str]:
        """Warnings about names in `dxb.lock` that the plan does not use."""
        calls = dict(graph.calls()) if self.names else {}
        for node, names in self.names.items():
            call = calls.get((node.removeprefix(f"{self.recipe}:"),))
            used = call.options.get("names") if call is not None else None
            for name, binding in names.items():
                if isinstance(used, dict):
                    if binding.at_px and not used.get(name, {}).get("locked"):
                        yield f"{LOCK} binds `{name}` in another way than the recipe; `dxb bind {node}` renews it"
                elif node.startswith(f"{self.recipe}:"):
                    gone = f"{LOCK} binds `{name}`, but `{node}` gives no names"
                    yield f"{gone}; `dxb bind {node} --remove {name}`"

    @cached_property
    def past_builds(self) -> History:
        """The history of this request on this machine."""
        return self._past(self.variant)

    def _past(self, variant: str) -> History:
        from dextera_build.runs.history import History

        return History(self.store, self.recipe, self.workspace, variant, self._built_last())

    @cached_property
    def history(self) -> dict[str, Entry]:
        """Node address -> entry of the last run that finished the node, of the successful ones if there are any."""
        return self.past_builds.all()

    @cached_property
    def last_nodes(self) -> dict[str, Mapping[str, Any]]:
        """Node -> its end in the last run of the request that built all of it, or in a later one of some targets.

        Nodes known only from older runs are left out, and so are copies that their group no longer had later.
        """
        from dextera_build.runs import log

        found: dict[str, Mapping[str, Any]] = {}
        for run in reversed(self._last_runs()):
            for event in log.lines(self.store, run):
                if event["event"] == "group_opened":
                    group = f"{event['group']}["
                    copies = tuple(f"{group}{label}]" for label in event["labels"])
                    found = {
                        node: end
                        for node, end in found.items()
                        if not node.startswith(group) or node.startswith(copies)
                    }
                elif event["event"] == "node_finished" and event["output"] and event["node"] in self.history:
                    found[event["node"]] = event
        return found

    def _last_runs(self) -> list[str]:
        """The request's successful runs, newest first, up to one that built the default targets; else its last run."""
        from dextera_build.runs import log

        found: list[str] = []
        for run in log.those(self.store, self.recipe, self.variant, workspace=self._mark, ok=True):
            found.append(run)
            if self._default <= {*next(log.lines(self.store, run))["targets"]}:
                break
        return found or [run for run in (self.last_run(),) if run]

    @cached_property
    def _default(self) -> set[str]:
        """The recipe's default targets; empty if it cannot be planned, so that every run has all of them."""
        try:
            return set(map(str, addresses(self.plan(incomplete=True).graph, "")))
        except DxbError:
            return set()

    def last_run(self) -> str | None:
        """Id of the request's last successful run, else of its last one; None if there is none."""
        from dextera_build.runs import log

        runs = (log.latest(self.store, self.recipe, self.variant, workspace=self._mark, ok=ok) for ok in (True, False))
        return next(filter(None, runs), None)

    @property
    def _mark(self) -> str:
        """The project's mark in logs of runs."""
        from dextera_build.runs import workspaces

        return workspaces.mark(self.workspace)

    def past(self, node: str) -> Entry:
        """The history entry of a node; that of the store's result if only recipes that use this one have built it.

        Raises:
            UsageError: There is no such recipe, or the node was never built.
        """
        if node not in self.history and (found := self._used(node)) is not None:
            self.history[node] = found
        if node not in self.history:
            refuse_unknown(self.project, self.recipe)
            self._refuse_unplanned(node)
            known = sorted(self.history)
            raise UsageError(
                f"`{self.recipe}:{node}` was never built here",
                code="DXB-U109",
                facts={**({"request": self.variant[1:]} if self.variant else {}), "built": listing(known)},
                hint=did_you_mean(node, known) or self._to_build(node),
            )
        return self.history[node]

    def _refuse_unplanned(self, node: str) -> None:
        """Raise the error of a node that the recipe does not have, if the recipe can be planned."""
        from dextera_build.engine.graph import parse_address

        try:
            graph = self.plan(incomplete=True).graph
        except DxbError:
            return
        known = {".".join(call[:size]) for call, _ in graph.calls() for size in range(1, len(call) + 1)}
        if not node_among(known, ".".join(parse_address(node).call)):  # fields may follow the node
            addresses(graph, node)

    def _to_build(self, node: str) -> str:
        return f"`dxb build '{self.recipe}:{node}'{inputs_to_give(self.project, self.recipe)}`"

    def _used(self, node: str) -> Entry | None:
        """The entry of a node whose present result is in the store, because another recipe built it."""
        from dextera_build.engine.dry import plan as dry
        from dextera_build.runs.history import Entry

        try:
            graph = self.plan().graph
            planned = [found for found in dry(graph, addresses(graph, node), self.store) if found.address == node]
        except DxbError:
            return None
        known = self.store.actions.known(planned[0].key) if planned and planned[0].key else None
        if known is None or not planned[0].key:
            return None
        return Entry(planned[0].key, known.key_document, "", known.seconds, 0.0)

    def output(self, node: str) -> str:
        """Digest of a node's last output.

        Raises:
            UsageError: The node was never built.
            RuleError: The node was built, but the store no longer holds its output.
        """
        found = self.store.actions.find(self.past(node).key)
        if found is None or not found.is_whole:
            state = "was built, but the store no longer holds it" if found is None else f"is known, but {NO_BYTES}"
            raise RuleError(f"`{self.recipe}:{node}` {state}", code="DXB-B401", hint=self._to_build(node))
        return found.result.output

    def is_bare(self, key: str) -> bool:
        """Whether the result of a key is known without its bytes."""
        found = self.store.actions.find(key)
        return found is not None and not found.is_whole

    def artifact(self, node: str) -> Artifact:
        """A node's last output, decoded."""
        document = self.document(node)
        return self.decoded(node, str(document["rule"]), self.output(node))

    def decoded(self, node: str, rule: str, output: str) -> Artifact:
        """The artifact that a node's rule returned, by its digest."""
        from dextera_build.artifacts.core.forms import type_among
        from dextera_build.store import headers

        returns, reader = self.project.library.find(rule).rule.returns, self.store.reader
        with headers.reading(f"`{node}`"):
            found: Artifact = type_among(returns, output, reader).decode(output, reader)
        return found

    def document(self, node: str) -> dict[str, Any]:
        """Key document of a node's last build."""
        import json

        loaded: dict[str, Any] = json.loads(self.store.blobs.get(self.past(node).key_document))
        return loaded


def node_among(known: Container[str], address: str) -> str:
    """The longest beginning of an address that is a known node, `body[mug].mesh` of `body[mug].mesh.mesh`; else ""."""
    while address and address not in known:
        address = address.rpartition(".")[0]
    return address


def variant_of(profile: str, added: Added) -> str:
    """The variant of a request: a profile other than the project's own, and additions; "" without any."""
    if not (profile or added):
        return ""
    inputs = {name: path if ":" in path else os.path.abspath(path) for name, path in added.inputs.items()}
    # The last value of an option wins, so the sort by option name must be stable.
    settings = sorted(added.settings, key=lambda text: text.partition("=")[0])
    said = [profile, sorted(inputs.items()), settings, sorted(added.backends.items())]
    words = [profile, *added.settings, *map("=".join, added.backends.items())]
    words += [f"{name}={os.path.basename(path)}" for name, path in inputs.items()]
    text = "+".join(redact(word) for word in words if word)
    readable = re.sub(r"[^A-Za-z0-9._=+]+", "-", text)[:_LONGEST].strip("-.")
    return f"@{readable}-{digests.of_value(said)[:8]}"


def addresses(graph: Graph, target: str) -> list[Address]:
    """Addresses in a graph for a target name, a node address or "" (`default`).

    Raises:
        UsageError: The graph has no such target or node.
    """
    from dextera_build.engine.graph import Address, parse_address

    if target in graph.targets or not target:
        return [Address(call) for call in graph.targets[target or "default"]]
    address = parse_address(target)
    calls = [call for call, _ in graph.calls()]
    below = [call for call in calls if call[: len(address.call)] == address.call]
    if not below:
        known = [*graph.targets, *(".".join(call) for call in calls)]
        raise UsageError(
            f"`{graph.name}` has no node `{target}`",
            code="DXB-U110",
            facts={"nodes": listing(known, most=40)},
            hint=did_you_mean(".".join(address.call), known),
        )
    return [Address(call, address.labels) for call in below]

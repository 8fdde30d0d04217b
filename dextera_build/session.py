"""What verbs do with a project: plan a recipe, find its targets, find what past runs made of its nodes."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

from dextera_build import digest as digests
from dextera_build.errors import RuleError, UsageError, did_you_mean, listing
from dextera_build.project.project import Project
from dextera_build.redact import redact
from dextera_build.runs.snapshot import LAST

# A build of which nothing changed loads none of these.
if TYPE_CHECKING:
    from dextera_build.artifacts.base import Artifact
    from dextera_build.engine.graph import Address, Graph
    from dextera_build.recipe.plan import Plan
    from dextera_build.runs.history import Entry, History
    from dextera_build.store.store import Store


NO_BYTES = "its bytes are not in the store"
"""What is said of a bare result."""
warnings: dict[str, None] = {}
"""What sessions of this process found that a person has to know; the command line prints it."""


def reading(project: Project) -> Store:
    """The store of a project for a verb that only reads; a missing folder is not made, and noted in `warnings`."""
    from dextera_build.store.store import Store

    store = Store(project.cache, make=False)
    if not store.root.is_dir():
        folder, origin = project.shown(store.root), project.config["cache"].origin
        warnings[f"there is no store at `{folder}` yet (from: {origin})"] = None
    return store


_LONGEST = 40
"""Characters of the readable part of a variant's name."""


@dataclass(frozen=True)
class Added:
    """What a request adds to a recipe, as it was written."""

    inputs: Mapping[str, str] = field(default_factory=dict)
    """Input of the recipe -> path, or target of another recipe."""
    settings: tuple[str, ...] = ()
    """`body[mug].mesh.wall_m=0.004`."""
    backends: Mapping[str, str] = field(default_factory=dict)
    """Rule -> backend."""

    def __bool__(self) -> bool:
        return bool(self.inputs or self.settings or self.backends)


class Session:
    """One recipe of a project, as a verb sees it.

    Args:
        project: Where to work.
        recipe: The recipe's address.
        added: What the request adds to it.
        makes: Something is to be built, so that the store is made where it is not there.
        last: Where the request adds nothing and no flag names a profile, the past is that of the request that was built
            last; a profile that the environment names must be its profile.
    """

    def __init__(
        self, project: Project, recipe: str, added: Added | None = None, *, makes: bool = False, last: bool = False
    ) -> None:
        self.project = project
        self.recipe = recipe
        self.added = added or Added()
        self._makes, self._last = makes, last

    @cached_property
    def store(self) -> Store:
        """The project's store."""
        from dextera_build.store.store import Store

        return Store(self.project.cache) if self._makes else reading(self.project)

    @cached_property
    def variant(self) -> str:
        """What tells the files and the past of a request from those of the recipe's own: `@gpu-1a2b3c4d`, or ""."""
        project, added = self.project, self.added
        profile = project.profile if project.profile != project.own_profile else ""
        if self._last and not added and project.config["profile"].origin != "command line":
            last = self._built_last()
            if not profile or last.startswith(f"@{profile}+"):
                return last
        if not (profile or added):
            return ""
        inputs = {name: path if ":" in path else os.path.abspath(path) for name, path in added.inputs.items()}
        # Of two values for one option the later one counts, so these stay in their order.
        settings = sorted(added.settings, key=lambda text: text.partition("=")[0])
        said = [profile, sorted(inputs.items()), settings, sorted(added.backends.items())]
        words = [profile, *added.settings, *map("=".join, added.backends.items())]
        words += [f"{name}={os.path.basename(path)}" for name, path in inputs.items()]
        text = "+".join(redact(word) for word in words if word)
        readable = re.sub(r"[^A-Za-z0-9._=+]+", "-", text)[:_LONGEST].strip("-.")
        return f"@{readable}-{digests.of_value(said)[:8]}"

    def note_last(self) -> None:
        """Remember that this request is the one of its recipe that was built last."""
        if self._built_last() != self.variant:
            self.store.state.put(LAST, {self.last_name: self.variant.encode()})

    @cached_property
    def last_name(self) -> str:
        """The name under which the store remembers which request of the recipe was built last."""
        return digests.of_value([str(self.project.root), self.recipe])[:16]

    def _built_last(self) -> str:
        found = self.store.state.get(LAST, self.last_name)
        return found.decode(errors="replace") if found else ""

    def plan(self) -> Plan:
        """The recipe, resolved, with what the request adds.

        Raises:
            UsageError: No recipe is called so.
        """
        from dextera_build.recipe import settings
        from dextera_build.recipe.plan import Request, plan

        if self.project.recipe(self.recipe) is None:
            raise no_recipe(self.project, self.recipe)
        texts, added = map(settings.parse, self.added.settings), self.added
        request = Request(self.project.profile, added.inputs, tuple(texts), added.backends)
        made = plan(self.recipe, self.project.recipe, self.project.library, self.project.root, request)
        self.project.forget_recipes()
        if self.project.console != "jsonl":
            warnings.update(dict.fromkeys(self.project.library.warnings.values()))
        return made

    @cached_property
    def past_builds(self) -> History:
        """What this machine remembers of the recipe."""
        from dextera_build.runs.history import History

        return History(self.store, self.recipe, str(self.project.root), self.variant)

    @cached_property
    def history(self) -> dict[str, Entry]:
        """Node address -> what the last run that finished it left behind."""
        return self.past_builds.all()

    @cached_property
    def last_nodes(self) -> list[str]:
        """Nodes that the recipe's last run brought up to date; what only older runs knew is not among them."""
        from dextera_build.runs import log

        run = log.latest(self.store, self.recipe, self.variant)
        events = log.read(self.store, run) if run else []
        return [
            event["node"]
            for event in events
            if event["event"] == "node_finished" and event["output"] and event["node"] in self.history
        ]

    def past(self, node: str) -> Entry:
        """What is known of a node that was built.

        Raises:
            UsageError: It never was.
        """
        if node not in self.history:
            known = sorted(self.history)
            raise UsageError(
                f"`{self.recipe}:{node}` was never built here",
                code="DXB-U109",
                facts={**({"request": self.variant[1:]} if self.variant else {}), "built": listing(known, most=30)},
                hint=did_you_mean(node, known) or f"`dxb build '{self.recipe}:{node}'`",
            )
        return self.history[node]

    def output(self, node: str) -> str:
        """Digest of what a node returned last.

        Raises:
            UsageError: It was never built.
            RuleError: It was, but the store no longer holds it.
        """
        found = self.store.actions.find(self.past(node).key)
        if found is None or not found.is_whole:
            state = "was built, but the store no longer holds it" if found is None else f"is known, but {NO_BYTES}"
            raise RuleError(
                f"`{self.recipe}:{node}` {state}", code="DXB-B401", hint=f"`dxb build '{self.recipe}:{node}'`"
            )
        return found.result.output

    def artifact(self, node: str) -> Artifact:
        """What a node returned last, decoded."""
        document = self.document(node)
        from dextera_build.store import headers

        kind: Any = self.project.library.find(str(document["rule"])).rule.returns
        with headers.reading(f"`{node}`"):
            decoded: Artifact = kind.decode(self.output(node), self.store.reader)
        return decoded

    def document(self, node: str) -> dict[str, Any]:
        """The key document that a node was built under last."""
        import json

        loaded: dict[str, Any] = json.loads(self.store.blobs.get(self.past(node).key_document))
        return loaded


def no_recipe(project: Project, name: str) -> UsageError:
    """The error about a recipe that does not exist."""
    known = [address for address, _ in project.recipes()]
    return UsageError(
        f"no recipe is called `{name}`",
        code="DXB-U108",
        facts={"recipes": listing(known, most=30)},
        hint=did_you_mean(name, known) or "`dxb ls` shows all of them",
    )


def addresses(graph: Graph, target: str) -> list[Address]:
    """What a target name, a node address or nothing (`default`) stands for in a graph.

    Raises:
        UsageError: It stands for nothing.
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

"""The config of a bundle: its builds, their nodes, and which results it holds."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal, TypeAlias

from dextera_build import digest as digests
from dextera_build.bundle import documents
from dextera_build.bundle.documents import BODY, DIGEST, FLAG, SECONDS, TEXT, Form, maybe
from dextera_build.bundle.errors import ill_formed

FORM = 4
_WHAT = "the config"
Closure: TypeAlias = Literal["targets", "full"]
"""`targets`: whole results of the targets, bare ones of all other nodes. `full`: whole results of every node."""
_NODE = {
    "node": TEXT,
    "rule": TEXT,
    "backend": maybe(TEXT),
    "key": DIGEST,
    "output": DIGEST,
    "result": maybe(DIGEST),
    "is_whole": FLAG,
    "seconds": SECONDS,
    "depends_on": [TEXT],
    "files": {TEXT: TEXT},
}
_CONFIG = {
    "form": Form(f"{FORM}, the form that this dxb reads", lambda it: it == FORM),
    "closure": Form("`targets` or `full`", lambda it: it in ("targets", "full")),
    "dxb": TEXT,
    "builds": [{"recipe": TEXT, "targets": [TEXT], "profile": TEXT, "nodes": [_NODE]}],
    "recipes": {BODY: BODY},
}
_RECIPE = re.compile(r"[A-Za-z0-9_-]+(/[A-Za-z0-9_-]+)*")


@dataclass(frozen=True)
class Node:
    """One node of a build."""

    node: str
    """Its address within the recipe."""
    rule: str
    backend: str | None
    key: str
    output: str
    """Digest of the output's header."""
    result: str | None
    """Digest of its `result.json`; None if the bundle does not hold the result."""
    is_whole: bool
    """Whether the bundle holds all blobs of the result; otherwise it is bare."""
    seconds: float
    """How long the rule ran [s]."""
    depends_on: tuple[str, ...] = ()
    """Nodes of the same build."""
    files: Mapping[str, str] = field(default_factory=dict)
    """Slot -> project file or folder."""


@dataclass(frozen=True)
class Build:
    """Targets of one recipe, with every node that they need."""

    recipe: str
    targets: tuple[str, ...]
    """Nodes."""
    profile: str
    nodes: tuple[Node, ...]


@dataclass(frozen=True)
class Contents:
    """The config of a bundle."""

    closure: Closure
    dxb: str
    """Version of dxb that made it."""
    builds: tuple[Build, ...]
    recipes: Mapping[str, str]
    """Address -> YAML."""

    def nodes(self) -> Iterator[tuple[str, Node]]:
        """Every node with its full address."""
        for build in self.builds:
            yield from ((f"{build.recipe}:{node.node}", node) for node in build.nodes)

    def targets(self) -> list[str]:
        """Full addresses of all targets."""
        return [f"{build.recipe}:{target}" for build in self.builds for target in build.targets]

    def spell(self) -> bytes:
        """Canonical JSON."""
        return digests.canonical(self._plain())

    @classmethod
    def read(cls, data: bytes) -> Contents:
        """Parse an untrusted config.

        Raises:
            BundleRefused: It is malformed.
        """
        raw = documents.parse(data, _CONFIG, _WHAT)
        builds = tuple(map(_build, raw["builds"]))
        found = cls(raw["closure"], raw["dxb"], builds, raw["recipes"])
        if not builds:
            raise ill_formed(_WHAT, "there is no build in it")
        for address in (*found.recipes, *(build.recipe for build in builds)):
            if not _RECIPE.fullmatch(address):
                raise ill_formed(_WHAT, f"`{address[:80]}` is not the address of a recipe")
        documents.refuse_other_spelling(data, found._plain(), _WHAT)
        return found

    def _plain(self) -> dict[str, Any]:
        return {"form": FORM, **asdict(self)}


def _build(raw: dict[str, Any]) -> Build:
    rows = [{name: row[name] for name in _NODE} | {"depends_on": tuple(row["depends_on"])} for row in raw["nodes"]]
    nodes = tuple(Node(**row) for row in rows)
    known = {node.node: node for node in nodes}
    if len(known) != len(nodes):
        raise ill_formed(_WHAT, "a node is listed twice")
    if not raw["targets"]:
        raise ill_formed(_WHAT, "it has no targets")
    for name in (*raw["targets"], *(name for node in nodes for name in node.depends_on)):
        if name not in known:
            raise ill_formed(_WHAT, f"there is no node `{name}`")
    for name in raw["targets"]:
        if known[name].result is None or not known[name].is_whole:
            raise ill_formed(_WHAT, f"the target `{name}` has no result")
    return Build(raw["recipe"], tuple(raw["targets"]), raw["profile"], nodes)

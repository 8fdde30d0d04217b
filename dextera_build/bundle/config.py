"""The config of a bundle: its builds, their nodes, and which results it holds."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias, get_args

from dextera_build import digest as digests
from dextera_build.bundle import documents
from dextera_build.bundle.errors import ill_formed

FORM = 3
Closure: TypeAlias = Literal["targets", "full"]
"""`targets`: whole results of the targets, bare ones of all other nodes. `full`: whole results of every node."""
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
        return digests.canonical(
            {
                "form": FORM,
                "closure": self.closure,
                "dxb": self.dxb,
                "builds": [_spell_build(build) for build in self.builds],
                "recipes": dict(self.recipes),
            }
        )

    @classmethod
    def read(cls, data: bytes) -> Contents:
        """Parse an untrusted config.

        Raises:
            BundleRefused: It is malformed.
        """
        what = "the config"
        reader = documents.Reader(documents.parse(data, what), what)
        if reader.raw.get("form") != FORM:
            raise ill_formed(what, f"its form is not {FORM}, the one that this dxb reads")
        closure = reader.text("closure")
        if closure not in get_args(Closure):
            raise ill_formed(what, "`closure` is neither `targets` nor `full`")
        recipes = documents.Reader(reader.raw.get("recipes"), "`recipes` of the config")
        found = cls(
            "full" if closure == "full" else "targets",
            reader.text("dxb"),
            tuple(_build(raw) for raw in reader.items("builds")),
            {_address(name): recipes.body(name) for name in recipes.raw},
        )
        if not found.builds:
            raise ill_formed(what, "there is no build in it")
        return found


def _spell_build(build: Build) -> dict[str, Any]:
    nodes = [{**vars(node), "depends_on": list(node.depends_on), "files": dict(node.files)} for node in build.nodes]
    return {**vars(build), "targets": list(build.targets), "nodes": nodes}


def _build(raw: object) -> Build:
    what = "a build of the config"
    reader = documents.Reader(raw, what)
    nodes = tuple(_node(item) for item in reader.items("nodes"))
    known = {node.node: node for node in nodes}
    if len(known) != len(nodes):
        raise ill_formed(what, "a node stands twice")
    targets = reader.texts("targets")
    if not targets:
        raise ill_formed(what, "it has no targets")
    for name in (*targets, *(name for node in nodes for name in node.depends_on)):
        if name not in known:
            raise ill_formed(what, f"there is no node `{name}`")
    for name in targets:
        if known[name].result is None or not known[name].is_whole:
            raise ill_formed(what, f"the target `{name}` has no result")
    return Build(_address(reader.text("recipe")), targets, reader.text("profile"), nodes)


def _node(raw: object) -> Node:
    reader = documents.Reader(raw, "a node of the config")
    return Node(
        node=reader.text("node"),
        rule=reader.text("rule"),
        backend=reader.maybe("backend"),
        key=reader.digest("key"),
        output=reader.digest("output"),
        result=reader.maybe_digest("result"),
        is_whole=reader.raw.get("is_whole") is True,
        seconds=reader.seconds("seconds"),
        depends_on=reader.texts("depends_on"),
        files=reader.table("files"),
    )


def _address(text: str) -> str:
    if not _RECIPE.fullmatch(text):
        raise ill_formed("the config", f"`{text[:80]}` is not the address of a recipe")
    return text

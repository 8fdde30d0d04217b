"""The schema of a recipe: inputs, nodes, groups, uses of other recipes, targets."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeAlias

from dextera_build.calls import secrets
from dextera_build.engine.graph import OnFailure
from dextera_build.errors import Place, RecipeError, did_you_mean, listing
from dextera_build.recipe import expect, matrix, strict_yaml
from dextera_build.recipe.expect import Expectation
from dextera_build.recipe.strict_yaml import Node

_MOST_BYTES = 64 << 20
"""Maximum size of a recipe file; 100,000 nodes take about 10 MB."""
_DEEPEST = 100
OF_GROUP: tuple[OnFailure, ...] = ("stop", "go_on", "leave_out")
"""Effects that a group may choose for copies that fail; unless they stop the build, collections do without them."""
OF_CALL: tuple[OnFailure, ...] = ("stop", "go_on")
KEYS = ("rule", "recipe", "backend", "salt", "on_failure", "given")
"""Keys of a node that are neither inputs nor options."""
_NAME = "abcdefghijklmnopqrstuvwxyz0123456789_"


@dataclass(frozen=True)
class InputDecl:
    """`capture: captures/mug`, or a mapping with `help`, `default` and `optional`."""

    name: str
    default: str | None
    optional: bool
    help: str
    place: Place


@dataclass(frozen=True, slots=True)
class CallDecl:
    """`{rule: factorize.mesh, seen: $object, wall_m: 0.003}`."""

    name: str
    rule: str
    backend: Node | None
    salt: str
    on_failure: OnFailure
    given: Node | None
    """The input without which the node does not exist."""
    arguments: dict[str, Node]
    node: Node
    place: Place

    @property
    def keys(self) -> Mapping[str, Place]:
        """Place of each key."""
        return self.node.keys


@dataclass(frozen=True)
class UseDecl:
    """`{recipe: twin/tabletop, capture: $capture}`: the nodes of another recipe, with its inputs bound."""

    name: str
    recipe: Node
    arguments: dict[str, Node]
    place: Place
    on_failure: OnFailure


@dataclass(frozen=True)
class GroupDecl:
    """`{each: $objects, as: object, nodes: {...}, overrides: {mug: {mesh: {...}}}}`."""

    name: str
    each: Node
    item: str
    nodes: dict[str, Decl]
    overrides: dict[str, dict[str, Node]]
    place: Place
    on_failure: OnFailure


@dataclass(frozen=True)
class MatrixDecl:
    """`{matrix: {seed: [1, 2]}, nodes: {...}}`: one copy of its nodes for every combination of values."""

    name: str
    copies: dict[str, dict[str, Node]]
    """Label -> the values of that copy."""
    nodes: dict[str, Decl]
    place: Place
    on_failure: OnFailure


Decl: TypeAlias = CallDecl | UseDecl | GroupDecl | MatrixDecl


@dataclass(frozen=True)
class Recipe:
    """A recipe as written."""

    address: str
    file: Path
    summary: str
    inputs: dict[str, InputDecl]
    nodes: dict[str, Decl]
    targets: dict[str, list[Node]] = field(default_factory=dict)
    extends: Node | None = None
    """Address of the recipe whose inputs, nodes and targets this one inherits."""
    files: tuple[Path, ...] = ()
    """Files that it was read from."""
    fallback: bool | None = None
    """Whether a build of it takes the next backend in line for one that is missing; None: as the base, else no."""
    expect: dict[str, Expectation] = field(default_factory=dict)
    """Bounds for metrics, by the name of the metric; not inherited, because they are those of these results."""

    def over(self, base: Recipe) -> Recipe:
        """This recipe merged over `base`: its own declarations win, and a node may replace an input."""
        inputs = {name: decl for name, decl in base.inputs.items() if name not in self.nodes}
        own = {name: self._described(decl, inputs.get(name)) for name, decl in self.inputs.items()}
        return replace(
            self,
            inputs={**inputs, **own},
            nodes={**base.nodes, **self.nodes},
            targets={**base.targets, **self.targets},
            files=(*self.files, *base.files),
            fallback=base.fallback if self.fallback is None else self.fallback,
        )

    @staticmethod
    def _described(decl: InputDecl, base: InputDecl | None) -> InputDecl:
        """An input that gives a value alone keeps the help of the one that it replaces."""
        return decl if decl.help or base is None else replace(decl, help=base.help)


def read(file: Path, address: str, shown: str | None = None) -> Recipe:
    """Read and check one recipe file.

    Args:
        file: The YAML file.
        address: `twin/laptop_scene`.
        shown: The file's name in messages.

    Raises:
        RecipeError: The file cannot be read or is invalid; with the place.
    """
    try:
        if file.stat().st_size > _MOST_BYTES:
            raise OSError(f"it is larger than {_MOST_BYTES >> 20} MiB")
        content = file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise RecipeError(f"cannot read the recipe: {error}", code="DXB-R100", where=Place(str(file))) from None
    secrets.refuse_written(content, shown or str(file))
    root = strict_yaml.parse(content, shown or str(file))
    parts = mapping(root, "a recipe", {"summary", "extends", "fallback", "inputs", "nodes", "targets", "expect"})
    extends = parts.get("extends")
    if extends is not None:
        text(extends, "extends")
    nodes = {} if extends and "nodes" not in parts else _nodes(parts.get("nodes"), root.place)
    inputs = {name: _input(name, node) for name, node in entries(parts.get("inputs"), "inputs").items()}
    for name in nodes:
        if name in inputs:
            raise RecipeError(f"`{name}` is an input and a node", code="DXB-R112", where=nodes[name].place)
    targets = {name: _target(node) for name, node in entries(parts.get("targets"), "targets").items()}
    summary = text(parts["summary"], "summary") if "summary" in parts else ""
    fallback = switch(parts["fallback"], "fallback") if "fallback" in parts else None
    expected = expect.read(parts.get("expect"))
    return Recipe(address, file, summary, inputs, nodes, targets, extends, (file,), fallback, expected)


def refuse_deep(trail: Sequence[str], where: Place) -> None:
    """Refuse recipes that use or extend one another more than a hundred deep.

    Args:
        trail: Addresses, from the requested recipe to the next one to read.
        where: Place that names the last of them.

    Raises:
        RecipeError: The trail is longer.
    """
    if len(trail) > _DEEPEST:
        raise RecipeError(
            f"recipes use or extend one another more than {_DEEPEST} deep",
            code="DXB-R115",
            where=where,
            facts={"trail": " -> ".join([*trail[:3], "...", *trail[-2:]])},
        )


def mapping(node: Node, what: str, allowed: Iterable[str]) -> dict[str, Node]:
    """The entries of a mapping with fixed keys."""
    if not isinstance(node.value, dict):
        raise RecipeError(f"{what} is a mapping, this is {node.kind}", code="DXB-R112", where=node.place)
    known = set(allowed)
    for key, place, _ in node.entries():
        if key not in known:
            raise RecipeError(
                f"{what} has no `{key}`",
                code="DXB-R112",
                where=place,
                facts={"known here": listing(known)},
                hint=did_you_mean(key, known),
            )
    return node.value


def entries(node: Node | None, what: str) -> dict[str, Node]:
    """The entries of a mapping from names, if there is one."""
    if node is None or node.value is None:
        return {}
    if not isinstance(node.value, dict):
        raise RecipeError(f"`{what}` is a mapping, this is {node.kind}", code="DXB-R112", where=node.place)
    for key, place, _ in node.entries():
        check_name(key, place)
    return node.value


def check_name(name: str, place: Place) -> None:
    """Refuse a text that is not a name."""
    if not name or set(name) - set(_NAME) or name[0].isdigit():
        raise RecipeError(
            f"`{name}` is not a name",
            code="DXB-R112",
            where=place,
            hint="lower-case letters, digits and `_`, not starting with a digit",
        )


def text(node: Node, what: str) -> str:
    """The value of a node that is text."""
    if not isinstance(node.value, str):
        raise RecipeError(f"`{what}` is text, this is {node.kind}", code="DXB-R112", where=node.place)
    return node.value


def switch(node: Node, what: str) -> bool:
    """The value of a node that is true or false."""
    if not isinstance(node.value, bool):
        raise RecipeError(f"`{what}` is true or false, this is {node.kind}", code="DXB-R112", where=node.place)
    return node.value


def listed(node: Node, what: str) -> tuple[str, ...]:
    """One name, or a list of at least one."""
    items = node.value if isinstance(node.value, list) else [node]
    if not items:
        raise RecipeError(f"`{what}` is empty", code="DXB-R112", where=node.place, hint="name one, or leave it out")
    return tuple(text(item, what) for item in items)


def _input(name: str, node: Node) -> InputDecl:
    if isinstance(node.value, str):
        return InputDecl(name, node.value, False, "", node.place)
    parts = mapping(node, f"the input `{name}`", {"help", "default", "optional"})
    default = parts.get("default")
    optional = parts.get("optional")
    return InputDecl(
        name,
        text(default, "default") if default is not None and default.value is not None else None,
        optional is not None and optional.value is True,
        text(parts["help"], "help") if "help" in parts else "",
        node.place,
    )


def _nodes(node: Node | None, where: Place) -> dict[str, Decl]:
    found: dict[str, Decl] = {}
    if node is not None and entries(node, "nodes"):
        found = {name: _node(name, inner, place) for name, place, inner in node.entries()}
    if not found:
        raise RecipeError("no nodes are declared", code="DXB-R112", where=node.place if node else where)
    return found


def _node(name: str, node: Node, place: Place) -> Decl:
    if not isinstance(node.value, dict):
        raise RecipeError(f"the node `{name}` is a mapping, this is {node.kind}", code="DXB-R112", where=node.place)
    kinds = [kind for kind in ("rule", "recipe", "each", "matrix") if kind in node.value]
    if len(kinds) != 1:
        raise RecipeError(
            f"the node `{name}` needs exactly one of `rule`, `recipe`, `each`, `matrix`",
            code="DXB-R112",
            where=place,
            facts={"it has": listing(node.value)},
        )
    if kinds == ["each"]:
        return _group(name, node, place)
    if kinds == ["matrix"]:
        parts = mapping(node, f"the matrix `{name}`", {"matrix", "nodes", "on_failure"})
        copies = matrix.copies(entries(parts["matrix"], "matrix"), parts["matrix"].place)
        return MatrixDecl(name, copies, _nodes(parts.get("nodes"), place), place, _on_failure(parts, OF_GROUP))
    if kinds == ["recipe"]:
        text(node.value["recipe"], "recipe")
        return UseDecl(name, node.value["recipe"], _arguments(node), place, _on_failure(node.value, OF_GROUP))
    return _call(name, node)


def _call(name: str, node: Node) -> CallDecl:
    salt = text(node.value["salt"], "salt") if "salt" in node.value else ""
    rule = text(node.value["rule"], "rule")
    backend = node.value.get("backend")
    if backend is not None:
        listed(backend, "backend")
    effect = _on_failure(node.value, OF_CALL)
    given = node.value.get("given")
    if given is not None:
        text(given, "given")
    return CallDecl(name, rule, backend, salt, effect, given, _arguments(node), node, node.value["rule"].place)


def _arguments(node: Node) -> dict[str, Node]:
    return {key: inner for key, inner in node.value.items() if key not in KEYS}


def _group(name: str, node: Node, place: Place) -> GroupDecl:
    parts = mapping(node, f"the group `{name}`", {"each", "as", "nodes", "overrides", "on_failure"})
    text(parts["each"], "each")
    item = text(parts["as"], "as") if "as" in parts else "item"
    check_name(item, parts["as"].place if "as" in parts else place)
    overrides = {
        label: entries(members, f"overrides.{label}")
        for label, members in entries(parts.get("overrides"), "overrides").items()
    }
    return GroupDecl(
        name, parts["each"], item, _nodes(parts.get("nodes"), place), overrides, place, _on_failure(parts, OF_GROUP)
    )


def _on_failure(parts: dict[str, Node], known: tuple[OnFailure, ...]) -> OnFailure:
    if "on_failure" not in parts:
        return "stop"
    told = text(parts["on_failure"], "on_failure")
    found = next((effect for effect in known if effect == told), None)
    if found is None:
        raise RecipeError(
            f"`on_failure` is {' or '.join(f'`{effect}`' for effect in known)}, not `{told}`",
            code="DXB-R131",
            where=parts["on_failure"].place,
            hint=did_you_mean(told, known),
        )
    return found


def _target(node: Node) -> list[Node]:
    items = node.value if isinstance(node.value, list) else [node]
    for item in items:
        text(item, "a target")
    return list(items)

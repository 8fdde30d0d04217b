"""Resolves a recipe into a graph of calls with rule, backend, complete options and inputs, ready for the engine."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from dextera_build.code.loader import Library
from dextera_build.engine.graph import Call, Graph, Group, Leaf, OnFailure, Output, mildest
from dextera_build.engine.graph import Plan as Plan
from dextera_build.errors import DxbError, Place, RecipeError, UsageError, did_you_mean, listing
from dextera_build.recipe import cycles, expect, groups, runs
from dextera_build.recipe.bindings import Names, fill
from dextera_build.recipe.calls import CallMaker
from dextera_build.recipe.kept import kind_of
from dextera_build.recipe.profiles import Profile
from dextera_build.recipe.schema import CallDecl, Decl, GroupDecl, InputDecl, MatrixDecl, Recipe, UseDecl, refuse_deep
from dextera_build.recipe.scope import Absent, Alias, Bound, GroupName, Scope, UseName, item
from dextera_build.recipe.settings import Setting, of_input
from dextera_build.recipe.strict_yaml import Node

_MOST_USED = 100_000
"""Limit on nodes of used recipes: a few small files that use one another can expand to a billion."""

Read = Callable[[str], Recipe | None]


@dataclass(frozen=True)
class Request:
    """Additions of the command line (or an API caller) to a recipe."""

    profile: Profile = field(default_factory=lambda: Profile("cpu"))
    inputs: Mapping[str, str] = field(default_factory=dict)
    """Input name -> path or target address; overrides the recipe."""
    settings: tuple[Setting, ...] = ()
    """Options that override the recipe: `--set 'body[mug].mesh.primitives.wall_m=0.004'`."""
    backends: Mapping[str, str] = field(default_factory=dict)
    """Rule -> backend, or several in order of preference, separated by commas; overrides the profile's."""
    incomplete: bool = False
    """Whether to plan without required inputs that are not given or not there; `Plan.absent` has an error for each."""
    names: Mapping[str, Names] = field(default_factory=dict)
    """Address of a node outside groups -> the names that `dxb.lock` binds there."""
    lock: Place = field(default_factory=lambda: Place("dxb.lock"))
    """The file of `names`."""


def plan(address: str, read: Read, library: Library, project: Path, request: Request | None = None) -> Plan:
    """Resolve a recipe.

    Args:
        address: `twin/laptop_scene`.
        read: Returns the recipe at an address, or None.
        library: Provides rules.
        project: Base folder of relative input paths.
        request: Additions of the caller.

    Raises:
        RecipeError: The recipe, or one that it uses, is invalid; with the place.
        UsageError: The request uses an unknown name.
        MachineError: A package of a rule is not installed; a backend that is missing is noted in the plan.
    """
    planner = _Planner(read, library, project, request or Request())
    recipe = planner.recipe(address, Place("the command line"))
    scope = planner.root(recipe)
    planner.fill()
    targets = {"default": [], **recipe.targets} if not recipe.targets else dict(recipe.targets)
    resolved = {name: tuple(planner.targets(scope, nodes)) for name, nodes in targets.items()}
    if not resolved.get("default"):
        resolved["default"] = tuple((name,) for name, decl in recipe.nodes.items() if isinstance(decl, CallDecl))
    graph = Graph(address, planner.tree(), resolved)
    cycles.refuse(graph)
    expect.refuse_unknown(recipe.expect, graph)
    rules = planner.maker.rules
    if any(library.find(facts.path).rule.runs for facts in rules):
        graph = runs.joined(graph, library, planner.maker.running)
        rules = graph.rules()
    return Plan(graph, tuple(planner.files), rules, tuple(planner.absent), planner.kinds)


class _Planner:
    """Plans in two passes: names (`root`), then calls (`fill`), because a name may be used before its declaration."""

    def __init__(self, read: Read, library: Library, project: Path, request: Request) -> None:
        self._read = read
        self._project = project
        self._request = request
        self.maker = CallMaker(library, request.profile, request.backends, request.settings)
        self.files: list[Path] = []
        self.absent: list[DxbError] = []
        """One error for each required input that is not given, or names a path where nothing is."""
        self.kinds: dict[str, str] = {}
        """See `Plan.kinds`."""
        self._recipes: dict[str, Recipe] = {}
        self._foreign: dict[str, Scope] = {}
        self._pending: dict[tuple[str, ...], tuple[CallDecl, Scope]] = {}
        """Address -> declaration and its scope."""
        self._groups: dict[tuple[str, ...], tuple[GroupDecl | MatrixDecl, groups.Over | None]] = {}
        """Address -> declaration, and the input that an `each` opens over."""
        self._opening: list[str] = []
        self._effects: list[OnFailure] = []
        """What the uses of the recipes that are open say of a failure."""
        self._used = 0
        """Number of nodes from used recipes."""
        self._calls: dict[tuple[str, ...], Call] = {}
        self._overrides: dict[tuple[str, ...], dict[str, dict[str, Call]]] = {}

    def recipe(self, address: str, where: Place) -> Recipe:
        """The recipe at an address, read once."""
        if address not in self._recipes:
            found = self._read(address)
            if found is None:
                raise RecipeError(
                    f"no recipe is called `{address}`", code="DXB-R110", where=where, hint="`dxb ls` shows all of them"
                )
            self._recipes[address] = found
            self.files += found.files
        return self._recipes[address]

    def root(self, recipe: Recipe) -> Scope:
        """Declare the recipe to build; the request may bind its inputs."""
        for name in self._request.inputs:
            if name not in recipe.inputs:
                raise UsageError(
                    f"`{recipe.address}` has no input `{name}`",
                    code="DXB-U104",
                    facts={"inputs": listing(recipe.inputs)},
                    hint=did_you_mean(name, recipe.inputs),
                )
        self.maker.fallback = recipe.fallback is True
        return self._open(recipe, "", (), {}, self._request.inputs)

    def fill(self) -> None:
        """Build every declared call."""
        self.maker.place_settings(self._pending)
        # Changes of the request first, because a wrong setting is the most frequent error.
        made = {address: self._call(address) for address in sorted(self._pending, key=self.maker.is_unset)}
        self._calls = {address: made[address] for address in self._pending}
        members: dict[tuple[str, ...], dict[str, tuple[CallDecl, Scope]]] = {group: {} for group in self._groups}
        for address, (decl, scope) in self._pending.items():
            if len(address) > 1:
                members[address[:-1]][address[-1]] = (decl, scope)
        for address, (group, _) in self._groups.items():
            self._overrides[address] = self._override(address, group, members[address])
        self.maker.warn_unread()

    def _call(self, address: tuple[str, ...]) -> Call:
        decl, scope = self._pending[address]
        decl = fill(decl, self._request.names.get(address[0], {}) if len(address) == 1 else {}, self._request.lock)
        around = self._groups[address[:-1]][0] if len(address) > 1 else None
        # The generic call of a matrix, without a label, is that of its first copy.
        first = next(iter(around.copies.values())) if isinstance(around, MatrixDecl) else None
        return self.maker.call(decl, scope, address, self.maker.values(decl, first))

    def targets(self, scope: Scope, nodes: Iterable[Node]) -> Iterator[tuple[str, ...]]:
        """The calls that targets of the recipe name; none for an input that is not given."""
        for node in nodes:
            bound = scope.resolve(f"${str(node.value).removeprefix('$')}", node.place)
            call = getattr(bound.input, "call", None)
            if call is not None:
                yield tuple(call)
            elif not isinstance(bound, Absent):
                raise RecipeError(f"`{node.value}` is not a node that can be built", code="DXB-R113", where=node.place)

    def tree(self) -> dict[str, Call | Group]:
        """Groups and calls, nested as in the graph."""
        root: dict[str, Call | Group] = {}
        blocks: dict[tuple[str, ...], dict[str, Any]] = {(): root}
        for address, (decl, over) in self._groups.items():
            members: dict[str, Call | Group] = {}
            blocks[address] = members
            over_what, named = groups.collection(decl, over), self.maker.labels(address)
            blocks[address[:-1]][address[-1]] = Group(
                address[-1], over_what, members, self._overrides[address], decl.place, decl.on_failure, named
            )
        for address, call in self._calls.items():
            blocks[address[:-1]][address[-1]] = call
        return root

    def _open(
        self,
        recipe: Recipe,
        prefix: str,
        group: tuple[str, ...],
        bound: Mapping[str, Alias | Bound],
        given: Mapping[str, str],
    ) -> Scope:
        if recipe.address in self._opening:
            loop = " -> ".join([*self._opening, recipe.address])
            raise RecipeError(
                "the recipe uses itself", code="DXB-R108", where=Place(str(recipe.file)), facts={"cycle": loop}
            )
        self._opening.append(recipe.address)
        refuse_deep(self._opening, Place(str(recipe.file)))
        scope = Scope(None)
        for name, decl in recipe.inputs.items():
            text = given.get(name, decl.default)
            if name in bound:
                scope.names[name] = bound[name]
            elif text is not None:
                where = of_input(name, text) if name in given else decl.place
                scope.names[name] = self._value(text, where, name in given, decl.help)
            elif decl.optional:
                scope.names[name] = Bound(None, lambda: type(None))
            else:
                scope.names[name] = self._absent(recipe, name, decl)
        self._declare(recipe.nodes, scope, prefix, group)
        self._opening.pop()
        return scope

    def _absent(self, recipe: Recipe, name: str, decl: InputDecl) -> Bound:
        error = UsageError(
            f"the input `{name}` of `{recipe.address}` is not given",
            code="DXB-U105",
            where=decl.place,
            facts={"it is": decl.help} if decl.help else None,
            hint=f"add `--input {name}=PATH`",
        )
        return self._without(error, name, decl.place)

    def _without(self, error: DxbError, name: str, where: Place) -> Absent:
        """An input that is not there, in a plan that may lack inputs; otherwise raise the error."""
        if not self._request.incomplete:
            raise error
        self.absent.append(error)
        return Absent(Leaf(Path(name), where), lambda: Any)

    def _declare(self, nodes: Mapping[str, Decl], scope: Scope, prefix: str, group: tuple[str, ...]) -> None:
        for name, decl in nodes.items():
            address = (*group, prefix + name)
            self._used += len(self._opening) > 1
            if self._used > _MOST_USED:
                raise RecipeError(
                    f"recipes within this recipe come to more than {_MOST_USED:,} nodes",
                    code="DXB-R116",
                    where=decl.place,
                    hint="`each` and `matrix` make copies of nodes without naming them",
                )
            if isinstance(decl, CallDecl) and decl.given is not None and self._is_omitted(decl.given, scope):
                scope.names[name] = Bound(None, lambda: type(None))
            elif isinstance(decl, CallDecl):
                self._pending[address] = (replace(decl, on_failure=mildest([decl.on_failure, *self._effects])), scope)
                self.maker.rule_file(decl)  # an unknown rule is refused here
                scope.names[name] = Bound(Output(address), partial(self.maker.returned, decl, address))
            elif isinstance(decl, UseDecl):
                scope.names[name] = UseName(self._use(decl, scope, f"{address[-1]}/", group))
            elif isinstance(decl, MatrixDecl):
                self._groups[address] = (decl, None)
                groups.refuse_many([self._groups[address[: depth + 1]][0] for depth in range(len(address))])
                inner = Scope(scope)
                self._declare(decl.nodes, inner, "", address)
                scope.names[name] = GroupName(address, inner)
            else:
                scope.names[name] = self._group(address, decl, scope)

    def _is_omitted(self, given: Node, scope: Scope) -> bool:
        """Whether a node's `given` names an input that is not given."""
        return scope.resolve(str(given.value), given.place).input is None

    def _group(self, address: tuple[str, ...], decl: GroupDecl, scope: Scope) -> GroupName:
        def over() -> Bound:
            return scope.resolve(decl.each.value, decl.each.place)

        self._groups[address] = (decl, over)
        # The item has its own scope, so that `$body.object` is not visible from outside.
        around = Scope(scope, {decl.item: item(address, over, decl.each.place)})
        inner = Scope(around)
        self._declare(decl.nodes, inner, "", address)
        return GroupName(address, inner)

    def _use(self, decl: UseDecl, outer: Scope, prefix: str, group: tuple[str, ...]) -> Scope:
        recipe = self.recipe(decl.recipe.value, decl.recipe.place)
        for key, node in decl.arguments.items():
            if key not in recipe.inputs:
                raise RecipeError(
                    f"`{recipe.address}` has no input `{key}`",
                    code="DXB-R105",
                    where=node.place,
                    facts={"inputs": listing(recipe.inputs)},
                    hint=did_you_mean(key, recipe.inputs),
                )
        bound: dict[str, Alias | Bound] = {}
        for key, node in decl.arguments.items():
            text = str(node.value)
            if text.startswith("$"):
                bound[key] = Alias(lambda text=text, node=node: outer.resolve(text, node.place))  # type: ignore[misc]
            else:
                bound[key] = self._value(text, node.place, False)
        self._effects.append(decl.on_failure)
        found = self._open(recipe, prefix, group, bound, {})
        self._effects.pop()
        return found

    def _value(self, text: str, where: Place, from_cli: bool, needed: str = "") -> Bound:
        """Resolve an input's text: a target of another recipe (`robot/kuka_leap`, `reference/x:capture`) or a path."""
        address, _, target = text.partition(":")
        path = self._path(text, where, from_cli)
        kind = self.kinds[str(path)] = kind_of(str(path))
        if (target or not kind) and self._read(address) is not None:
            return self._foreign_target(address, target, where)
        if not kind:
            error = RecipeError(
                f"`{text}` is neither a file nor a recipe",
                code="DXB-R301",
                where=where,
                facts={"looked for": str(path), **({"needed": needed} if needed else {})},
                hint="`--input NAME=PATH` starts from the current folder"
                if from_cli
                else "put it there, or name another one: `--input NAME=PATH`",
            )
            return self._without(error, text, where)
        return Bound(Leaf(path, where), lambda: _leaf_type(kind))

    def _path(self, text: str, where: Place, from_cli: bool) -> Path:
        if from_cli:
            return Path(text).absolute()
        return Path(where.file).parent / text if text.startswith("./") else self._project / text

    def _foreign_target(self, address: str, target: str, where: Place) -> Bound:
        recipe = self.recipe(address, where)
        if address not in self._foreign:
            effects, self._effects = self._effects, []  # every node that names it shares its nodes
            self._foreign[address] = self._open(recipe, f"{address}:", (), {}, {})
            self._effects = effects
        scope = self._foreign[address]
        if not target:
            chosen = recipe.targets.get("default", [])
            if len(chosen) != 1:
                raise RecipeError(
                    f"`{address}` has {len(chosen)} default targets, name one",
                    code="DXB-R113",
                    where=where,
                    facts={"nodes": listing(scope.names)},
                    hint=f"`{address}:{min(recipe.nodes)}`",
                )
            target = str(chosen[0].value)
        return scope.resolve(f"${target}", where)

    def _override(
        self,
        address: tuple[str, ...],
        decl: GroupDecl | MatrixDecl,
        members: Mapping[str, tuple[CallDecl, Scope]],
    ) -> dict[str, dict[str, Call]]:
        if isinstance(decl, MatrixDecl):
            return groups.swept(self.maker, address, decl, members)
        found: dict[str, dict[str, Call]] = {}
        labels = {
            **decl.overrides,
            **{label: {} for label in self.maker.labels(address) if label not in decl.overrides},
        }
        for label, changes in labels.items():
            for name, node in changes.items():
                if name not in members or not isinstance(node.value, dict):
                    raise RecipeError(
                        f"`{name}` of `overrides.{label}` is not a node of this group",
                        code="DXB-R114",
                        where=node.place,
                        facts={"calls": listing(members)},
                        hint=did_you_mean(name, members),
                    )
            for name, (call, scope) in members.items():
                changed = changes[name].value if name in changes else {}
                if changed or self.maker.concerns((*address, name), label):
                    found.setdefault(label, {})[name] = self.maker.call(call, scope, (*address, name), changed, label)
        return found


def _leaf_type(kind: str) -> Any:
    from dextera_build.artifacts import base

    return getattr(base, kind)

"""Names in a recipe, and the resolution of `$name.field`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

from dextera_build.engine.graph import Gather, Input, Item, Leaf, Output, Pack
from dextera_build.errors import Place, RecipeError, did_you_mean, listing
from dextera_build.recipe.kinds import field_type, overlap


@dataclass(frozen=True)
class Bound:
    """An input of the engine with its artifact type."""

    input: Input | None
    """None for an omitted optional input."""
    kind: Callable[[], Any]
    """Returns the artifact type; called late, because it may import a rule."""

    def follow(self, fields: tuple[str, ...], where: Place) -> Bound:
        """The same input, projected to a field of a field.

        Raises:
            RecipeError: There is no such field, or it is not an artifact.
        """
        if not fields or self.input is None:
            return self
        if isinstance(self.input, Leaf | Pack):
            raise RecipeError("a file has no fields", code="DXB-R107", where=where)
        inner = replace(self.input, fields=(*self.input.fields, *fields))
        return Bound(inner, lambda: field_type(self.kind(), fields, where))


@dataclass(frozen=True)
class Absent(Bound):
    """A required input that is not given: any type that fits all slots it is given to, with every field."""

    readers: list[tuple[str, Any]] = field(default_factory=list)
    """Slot, as errors name it, and its type, for each slot it is given to."""
    parts: dict[tuple[str, ...], Absent] = field(default_factory=dict)
    """Fields -> the same for their targets."""

    def follow(self, fields: tuple[str, ...], where: Place) -> Bound:
        """The input itself, or an unknown of its own for each path of fields."""
        return self.parts.setdefault(fields, Absent(self.input, self.kind)) if fields else self

    def narrow(self, reader: str, wanted: Any) -> tuple[str, Any] | None:
        """Note a slot it is given to; returns an earlier one if no artifact fits both."""
        clash = next((told for told in self.readers if not overlap(told[1], wanted)), None)
        self.readers.append((reader, wanted))
        return clash


@dataclass(frozen=True)
class Alias:
    """An alias of a reference, resolved on use because its target may be declared later."""

    resolve: Callable[[], Bound]


@dataclass(frozen=True)
class GroupName:
    """The name of a group; `scope` holds its members."""

    address: tuple[str, ...]
    scope: Scope


@dataclass(frozen=True)
class UseName:
    """The name of a used recipe; `scope` holds its nodes."""

    scope: Scope


Entry: TypeAlias = Bound | Alias | GroupName | UseName


@dataclass
class Scope:
    """Names of one block; unknown names are looked up in the enclosing block."""

    parent: Scope | None
    names: dict[str, Entry] = field(default_factory=dict)

    def visible(self) -> dict[str, Entry]:
        """Every name that can be used here."""
        outer = self.parent.visible() if self.parent else {}
        return {**outer, **self.names}

    def resolve(self, text: str, where: Place) -> Bound:
        """Resolve `$a.b.c`.

        Raises:
            RecipeError: A part is unknown; the message lists the known names.
        """
        first, *rest = text.removeprefix("$").split(".")
        scope: Scope | None = self
        while scope is not None and first not in scope.names:
            scope = scope.parent
        names = scope.names if scope is not None else self.visible()
        return self._step(names, first, tuple(rest), "$", where)

    def _step(self, names: dict[str, Entry], first: str, rest: tuple[str, ...], before: str, where: Place) -> Bound:
        if first not in names:
            raise RecipeError(
                f"`{before}{first}` names nothing",
                code="DXB-R104",
                where=where,
                facts={"known here": listing(names, most=30)},
                hint=did_you_mean(first, names, form=f"`{before}{{}}`"),
            )
        entry = names[first]
        match entry:
            case Bound():
                return entry.follow(rest, where)
            case Alias():
                return entry.resolve().follow(rest, where)
            case UseName():
                return self._inside(entry.scope, first, rest, before, where)
            case GroupName():
                return _gathered(self._inside(entry.scope, first, rest, before, where), where)

    def _inside(self, scope: Scope, first: str, rest: tuple[str, ...], before: str, where: Place) -> Bound:
        if not rest:
            raise RecipeError(
                f"`{before}{first}` holds nodes, name one of them",
                code="DXB-R104",
                where=where,
                facts={"nodes": listing(scope.names)},
                hint=f"`{before}{first}.{min(scope.names)}`",
            )
        return self._step(scope.names, rest[0], rest[1:], f"{before}{first}.", where)


def _gathered(inner: Bound, where: Place) -> Bound:
    if not isinstance(inner.input, Output):
        raise RecipeError("only the outputs of a group's nodes can be used outside it", code="DXB-R104", where=where)

    def kind() -> Any:
        from dextera_build.artifacts.base import Collection

        return Collection[inner.kind()]  # type: ignore[misc]

    return Bound(Gather(inner.input.call, inner.input.fields), kind)


def item(group: tuple[str, ...], over: Callable[[], Bound], where: Place) -> Bound:
    """The binding of the item variable of a group over `over`."""

    def kind() -> Any:
        return field_type(over().kind(), ("items", "*"), where)

    return Bound(Item(group), kind)

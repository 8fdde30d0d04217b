"""Names of objects that `dxb.lock` binds, as options of the nodes that give names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # a no-op build reads `dxb.lock`, but no recipe
    from dextera_build.errors import Place
    from dextera_build.recipe.schema import CallDecl
    from dextera_build.recipe.strict_yaml import Node

RULE = "factorize.name"
"""The rule with an option `names`."""
PROPERTIES = ("phrase", "category", "material", "colour")
"""Options of a name that distinguish objects on any photograph."""


@dataclass(frozen=True)
class Binding:
    """The binding of a name."""

    at_px: tuple[int, int] | None = None
    """Column and row of a pixel of the object [px]; None: only in drafts that `dxb bind` tries."""
    photograph: str = ""
    """Digest of the pixels of the photograph that the point is on, see `geometry.pictures.digest_of`."""
    properties: Mapping[str, str] = field(default_factory=dict)
    """Properties that recognised the object, of PROPERTIES; empty if only the point did."""

    def options(self) -> dict[str, object]:
        """The binding as `factorize.name` takes it."""
        locked = {"locked": {"at_px": list(self.at_px), "photograph": self.photograph}} if self.at_px else {}
        return {**self.properties, **locked}


Names = Mapping[str, Binding]
"""Name -> its binding."""


def fill(decl: CallDecl, names: Names, where: Place) -> CallDecl:
    """The declaration with the bindings of `dxb.lock` added; `where` is that file.

    The recipe goes first: a name that it recognises by other properties than at the time of the binding, or by a point
    of its own, keeps the recipe's binding.
    """
    if decl.rule != RULE or not names:
        return decl
    from dextera_build.recipe.strict_yaml import Node

    own = decl.arguments.get("names")
    if own is not None and not isinstance(own.value, dict):
        return decl  # refused with the recipe's other options
    known: dict[str, Node] = dict(own.value) if own is not None else {}
    for name, binding in names.items():
        if name not in known or _said(known[name].plain()) == binding.properties:
            known[name] = _node(binding.options(), where)
    place = own.place if own is not None else where
    return replace(decl, arguments={**decl.arguments, "names": Node(known, place, dict.fromkeys(known, place))})


def _said(plain: object) -> object:
    return {key: value for key, value in plain.items() if value} if isinstance(plain, dict) else plain


def _node(value: object, where: Place) -> Node:
    from dextera_build.recipe.strict_yaml import Node

    if isinstance(value, dict):
        return Node({key: _node(inner, where) for key, inner in value.items()}, where, dict.fromkeys(value, where))
    return Node([_node(inner, where) for inner in value] if isinstance(value, list) else value, where)

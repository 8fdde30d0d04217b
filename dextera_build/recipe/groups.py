"""Collections that groups open over, and the copies of a matrix."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from dextera_build.engine.graph import Call, Fixed, Item, Output
from dextera_build.errors import RecipeError
from dextera_build.recipe import matrix
from dextera_build.recipe.schema import CallDecl, GroupDecl, MatrixDecl
from dextera_build.recipe.scope import Absent

if TYPE_CHECKING:
    from dextera_build.recipe.calls import CallMaker
    from dextera_build.recipe.scope import Bound, Scope

Address = tuple[str, ...]
Over = Callable[[], "Bound"]
"""The input named by an `each`; resolved late, because it may be declared later."""


def collection(decl: GroupDecl | MatrixDecl, over: Over | None) -> Output | Item | Fixed:
    """The input over which the engine opens a group.

    Raises:
        RecipeError: It is not the output of a node.
    """
    if isinstance(decl, MatrixDecl):
        return Fixed(tuple(decl.copies))
    assert over is not None
    bound = over()
    if isinstance(bound, Absent):
        return Fixed(())
    found = bound.input
    if not isinstance(found, Output | Item):
        raise RecipeError("`each` takes the output of a node", code="DXB-R105", where=decl.each.place)
    return found


def refuse_many(around: Sequence[GroupDecl | MatrixDecl]) -> None:
    """Refuse nested matrices with too many copies; these multiply, so they are counted before expansion.

    Args:
        around: Nested groups and matrices, innermost last.

    Raises:
        RecipeError: The innermost has too many copies.
    """
    copies = [(decl.name, len(decl.copies)) for decl in around if isinstance(decl, MatrixDecl)]
    facts = {name: f"{count} copies" for name, count in copies}
    matrix.refuse_many(math.prod(count for _, count in copies), around[-1].place, facts)


def swept(
    maker: CallMaker, address: Address, decl: MatrixDecl, members: Mapping[str, tuple[CallDecl, Scope]]
) -> dict[str, dict[str, Call]]:
    """Label -> member -> its call with the values of that copy, for members that use them.

    Raises:
        UsageError: A setting names a copy that does not exist.
    """
    maker.refuse_labels(address, decl.copies)
    return {
        label: {
            name: maker.call(call, scope, (*address, name), changed, label)
            for name, (call, scope) in members.items()
            if (changed := maker.values(call, values)) or maker.concerns((*address, name), label)
        }
        for label, values in decl.copies.items()
    }

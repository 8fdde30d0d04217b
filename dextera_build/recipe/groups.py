"""What a group opens over, and the copies of a matrix."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from dextera_build.engine.graph import Call, Fixed, Item, Output
from dextera_build.errors import RecipeError
from dextera_build.recipe import matrix
from dextera_build.recipe.schema import CallDecl, GroupDecl, MatrixDecl

if TYPE_CHECKING:
    from dextera_build.recipe.calls import CallMaker
    from dextera_build.recipe.scope import Bound, Scope

Address = tuple[str, ...]
Over = Callable[[], "Bound"]
"""What an `each` names; asked for late, because it may be declared later."""


def collection(decl: GroupDecl | MatrixDecl, over: Over | None) -> Output | Item | Fixed:
    """What the engine opens a group over.

    Raises:
        RecipeError: It is not what a node returns.
    """
    if isinstance(decl, MatrixDecl):
        return Fixed(tuple(decl.copies))
    assert over is not None
    found = over().input
    if not isinstance(found, Output | Item):
        raise RecipeError("`each` takes the output of a node", code="DXB-R105", where=decl.each.place)
    return found


def refuse_many(around: Sequence[GroupDecl | MatrixDecl]) -> None:
    """Copies of a matrix in a matrix multiply; they are counted before anything opens them.

    Args:
        around: The groups and matrices that hold one another, the innermost last.

    Raises:
        RecipeError: There are too many copies of the innermost.
    """
    copies = [(decl.name, len(decl.copies)) for decl in around if isinstance(decl, MatrixDecl)]
    facts = {name: f"{count} copies" for name, count in copies}
    matrix.refuse_many(math.prod(count for _, count in copies), around[-1].place, facts)


def swept(
    maker: CallMaker, address: Address, decl: MatrixDecl, members: Mapping[str, tuple[CallDecl, Scope]]
) -> dict[str, dict[str, Call]]:
    """Label -> member -> its call with the values of that copy, for members that speak of them.

    Raises:
        UsageError: A setting speaks of a copy that is not there.
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

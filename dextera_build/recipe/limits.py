"""How much a recipe may come to: a few small files that use one another can say a billion nodes."""

from __future__ import annotations

from collections.abc import Sequence

from dextera_build.errors import Place, RecipeError

MOST_BYTES = 64 << 20
"""Of one recipe file; 100,000 nodes take about 10 MB."""
_DEEPEST = 100
_MOST_USED = 100_000


def refuse_deep(trail: Sequence[str], where: Place) -> None:
    """Recipes may use or extend one another through a hundred files.

    Args:
        trail: Addresses, from the recipe that is asked for to the one that is about to be read.
        where: What names the last of them.

    Raises:
        RecipeError: There are more.
    """
    if len(trail) > _DEEPEST:
        raise RecipeError(
            f"recipes use or extend one another more than {_DEEPEST} deep",
            code="DXB-R115",
            where=where,
            facts={"trail": " -> ".join([*trail[:3], "...", *trail[-2:]])},
        )


def refuse_many(used: int, where: Place) -> None:
    """Nodes of used recipes count each time that the recipe is used.

    Args:
        used: Nodes of used recipes so far.
        where: What names the last of them.

    Raises:
        RecipeError: There are too many.
    """
    if used > _MOST_USED:
        raise RecipeError(
            f"recipes within this recipe come to more than {_MOST_USED:,} nodes",
            code="DXB-R116",
            where=where,
            hint="`each` and `matrix` make copies of nodes without naming them",
        )

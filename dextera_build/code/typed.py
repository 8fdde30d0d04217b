"""The rule that a file defines; one whose inputs or result have no type is refused: a plan could not tell what fits."""

from __future__ import annotations

from types import ModuleType
from typing import Any

from dextera_build.errors import Place, RecipeError
from dextera_build.rule.declaration import Rule


def rule_of(module: ModuleType, path: str, place: Place) -> Rule[Any, Any]:
    """The rule of a module.

    Args:
        module: The module of its file.
        path: Its address.
        place: The line of its function.

    Raises:
        RecipeError: There is none, or a parameter or its result has no type, or one that cannot be read.
    """
    found = getattr(module, path.rpartition(".")[2], None)
    if not isinstance(found, Rule):
        name = path.rpartition(".")[2]
        raise RecipeError(f"no function `{name}` with `@rule` in this file", code="DXB-R203", where=place)
    if found.untyped:
        raise _untyped(found.untyped, path, place)
    try:
        _ = found.returns
    except NameError as error:
        raise RecipeError(
            f"the types of the rule `{path}` cannot be read: {error}",
            code="DXB-R219",
            where=place,
            hint="import each type at the top of the file, not below `if TYPE_CHECKING`",
        ) from None
    return found


def _untyped(names: tuple[str, ...], path: str, place: Place) -> RecipeError:
    kinds = {name: "Context" if name == "ctx" else "..." for name in names}
    shown = ["`-> ...`" if name == "return" else f"`{name}: {kind}`" for name, kind in kinds.items()]
    return RecipeError(
        f"the rule `{path}` does not say the types of what it takes and returns",
        code="DXB-R219",
        where=place,
        facts={"without a type": ", ".join(names)},
        hint=f"write {', '.join(shown)} in its `def`, with types such as `Mesh`; `dxb help Mesh` shows one",
    )

"""A file or folder that is given where a rule takes something else."""

from __future__ import annotations

import os
from typing import Any

from dextera_build.engine.graph import Leaf
from dextera_build.errors import Place, RecipeError
from dextera_build.recipe.kinds import choices, type_name


def misfit(given: Leaf, text: str, slot: str, wanted: Any, read_at: Place) -> RecipeError:
    """The error for it, at the flag or the line that names the file.

    Args:
        given: The file or folder.
        text: The reference to it in the recipe: `$capture`.
        slot: Input of the rule that reads it.
        wanted: Type of that input.
        read_at: Place of the reference.
    """
    is_folder = given.path.is_dir()
    asked = {kind.__name__ for kind in choices(wanted)}
    hint = None
    if asked & {"File", "Folder"}:
        said = "folder" if "Folder" in asked else "file"
        hint = (
            f"name a {said}; `{os.path.normpath(given.path.parent)}` holds the file"
            if said == "folder"
            else f"name a {said} in it"
        )
    elif not is_folder:
        hint = "a rule turns a file into another artifact: `dxb help capture.file`, `dxb ls rules`"
    what = "folder" if is_folder else "file"
    return RecipeError(
        f"`{given.path.name}` is a {what}, but `{slot}` takes {type_name(wanted)}",
        code="DXB-R107",
        where=given.where,
        facts={"read as": f"`{text}` at {read_at}"},
        hint=hint,
    )

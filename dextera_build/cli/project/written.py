"""The address under which commands find a recipe that `dxb new` wrote, and what is needed before they do."""

from __future__ import annotations

from pathlib import Path

from dextera_build.project.project import Project


def address(project: Project, out: Path, place: Path) -> tuple[str, str]:
    """The address of a recipe, and the step to take first.

    Args:
        project: The project.
        out: The file that was written.
        place: Where such a recipe belongs, below the project's `recipes/`.

    Returns:
        The address, and a text that ends in a space, or "" if the file is in its place.
    """
    recipes, file = project.root.absolute() / "recipes", out.absolute()
    if file.is_relative_to(recipes) and file.suffix == ".yaml":
        return str(file.relative_to(recipes).with_suffix("")), ""
    shown = project.shown(place)
    return (
        str(place.relative_to(recipes).with_suffix("")),
        f"commands find recipes below `recipes/` alone: move it to {shown}, ",
    )


def hidden(project: Project, address: str) -> list[str]:
    """Lines of a warning if a recipe of this address in the project takes the place of one of dxb's."""
    own = project.root.absolute() / "recipes"
    others = [folder / f"{address}.yaml" for folder in project.recipe_folders() if folder.absolute() != own]
    if not any(each.is_file() for each in others):
        return []
    group, _, name = address.rpartition("/")
    return [
        f"warning: {address} of this project now takes the place of dxb's recipe of the same name",
        f"         to keep both, rename the file: recipes/{group}/my_{name}.yaml",
    ]

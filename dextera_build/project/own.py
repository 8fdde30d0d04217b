"""The recipes that are a project's own, without those of dxb."""

from __future__ import annotations

from pathlib import Path

from dextera_build.project.project import Project
from dextera_build.recipe.addresses import addresses


def folder(project: Project) -> Path:
    """Where the project's own recipes are."""
    return project.root.absolute() / "recipes"


def recipes(project: Project) -> list[str]:
    """Addresses of the project's own recipes, in the order of their files."""
    return [address for address, _ in addresses([str(folder(project))])]


def twin(project: Project) -> str:
    """The project's first own twin; the one of dxb's example if it has none."""
    known = [address for address in recipes(project) if address.startswith("twin/")]
    return next((address for address in known if not address.endswith("_again")), "twin/laptop_scene")

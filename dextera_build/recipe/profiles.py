"""Profiles: which backends a build prefers, as lists in files `recipes/profile/NAME.yaml`.

A rule that no list names takes the backends that declare the profile (`Backend.profiles`); if there is none, the
profile that this one extends decides.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from dextera_build.code.loader import RuleFile, bundled
from dextera_build.errors import RecipeError, UsageError, did_you_mean, listing
from dextera_build.recipe import strict_yaml
from dextera_build.recipe.addresses import PROFILES
from dextera_build.recipe.schema import listed, mapping, refuse_deep, text
from dextera_build.recipe.strict_yaml import Node


@dataclass(frozen=True)
class Profile:
    """Which backends a build prefers."""

    name: str
    summary: str = ""
    lists: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Rule -> its backends, in order of preference."""
    extended: Profile | None = None
    """The profile that decides for rules that this one does not list."""
    files: tuple[Path, ...] = ()
    """Files, existing or not, that determine it."""

    def preferred(self, found: RuleFile) -> tuple[tuple[str, ...], str]:
        """The backends of a rule in order of preference, and the profile that lists them; none if no profile does."""
        profile: Profile | None = self
        while profile is not None:
            declared = tuple(name for name, backend in found.backends.items() if profile.name in backend.facts.profiles)
            if names := profile.lists.get(found.path, declared):
                return names, profile.name
            profile = profile.extended
        return (), self.name


def folders(project: Path | None) -> list[Path]:
    """Folders of profiles, existing or not, the project's own first."""
    own = [project / "recipes"] if project is not None else []
    return [folder / PROFILES for folder in dict.fromkeys((*own, bundled("recipes")))]


def names(project: Path | None) -> Iterator[str]:
    """Names of all profiles."""
    yield from dict.fromkeys(file.stem for folder in folders(project) for file in sorted(folder.glob("*.yaml")))


def read(name: str, project: Path | None, shown: Callable[[Path], str] = str, trail: tuple[str, ...] = ()) -> Profile:
    """Read a profile and those that it extends.

    Args:
        name: `gpu`.
        project: The project's folder.
        shown: Spells a file for messages.
        trail: Names of the profiles that extend this one.

    Raises:
        UsageError: There is no such profile.
        RecipeError: A file is wrong, or the profile extends itself.
    """
    found = [folder / f"{name}.yaml" for folder in folders(project)]
    file = next((file for file in found if file.is_file()), None)
    if file is None:
        known = list(names(project))
        raise UsageError(
            f"no profile is called `{name}`",
            code="DXB-U103",
            facts={"profiles": listing(known)},
            hint=did_you_mean(name, known) or f"a file `recipes/{PROFILES}/{name}.yaml` makes one",
        )
    root = strict_yaml.parse(file.read_text(encoding="utf-8"), shown(file))
    parts = mapping(root, "a profile", {"summary", "extends", "backends"})
    lists = {rule: listed(node, f"backends of `{rule}`") for rule, node in _rules(parts.get("backends"))}
    summary = text(parts["summary"], "summary") if "summary" in parts else ""
    extended = None
    if "extends" in parts:
        base, trail = text(parts["extends"], "extends"), (*trail, name)
        refuse_deep(trail, parts["extends"].place)
        if base in trail:
            where, facts = parts["extends"].place, {"extends": " -> ".join((*trail, base))}
            raise RecipeError("the profile extends itself", code="DXB-R110", where=where, facts=facts)
        extended = read(base, project, shown, trail)
    return Profile(name, summary, lists, extended, (*found, *(extended.files if extended else ())))


def _rules(node: Node | None) -> Iterator[tuple[str, Node]]:
    if node is None:
        return
    if not isinstance(node.value, dict):
        raise RecipeError(f"`backends` is a mapping, this is {node.kind}", code="DXB-R112", where=node.place)
    yield from node.value.items()

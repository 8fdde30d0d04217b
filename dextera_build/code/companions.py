"""Companions: files whose code runs an artifact or a call, although no rule imports them.

They are next to the rule that made the artifact, such as `policy.py` for a checkpoint, or in a folder that an option
names, such as `primitives/lift/`; the file of a rule may itself be one, such as that of an observation term. An edit
of one makes the nodes stale that run it, and no others.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import ModuleType
from typing import TypeAlias

from dextera_build.code.loader import PACKAGE, Library, Root, RuleFile, imported

Companions: TypeAlias = Mapping[str, Sequence["Companion"]]
"""Slot, or option that names a folder -> companions, sorted by path."""
OWN = PACKAGE / "sim"
"""Where the folders lie that come with dxb: `primitives/`."""


@dataclass(frozen=True)
class Companion:
    """A companion as found on disk."""

    of: str
    """Path of the rule in its folder, `learn.act`, or its folder, `primitives/lift`."""
    file: Path
    root: Root | None
    """None for a folder of dxb."""

    @property
    def name(self) -> str:
        """The name of its folder, `act` of `rules/learn/act/policy.py`; of a rule's own file, the name of the rule."""
        return self.file.stem if self.own else self.file.parent.name

    @property
    def own(self) -> bool:
        """Whether it is the file of the rule itself."""
        return self.file.stem == self.of.rpartition(".")[2]

    @property
    def path(self) -> str:
        """`learn.act/policy`, from which `of_paths` finds it again."""
        return f"{self.of}/{self.file.stem}"

    @cached_property
    def module(self) -> ModuleType:
        """The imported module."""
        return imported(self.root, str(self), self.file)

    def __str__(self) -> str:
        return self.of if self.own else f"`{self.file.name}` of {self.of}"


def beside(found: RuleFile, stem: str) -> Companion:
    """The companion of a rule in a file of this name, whether it exists or not; with an empty name its own file."""
    return Companion(found.path, found.file.with_name(f"{stem}.py") if stem else found.file, found.root)


def in_folder(library: Library, folder: str, stem: str) -> Companion:
    """The companion in the first folder of this path, such as `primitives/lift`, whether it exists or not.

    The roots of rules come first, in their order, then dxb's own folders.
    """
    for root in library.roots:
        place = root.path / folder
        library.asked.add(str(place))
        if place.is_dir():
            return Companion(folder, place / f"{stem}.py", root)
    return Companion(folder, OWN / folder / f"{stem}.py", None)


def names_in(library: Library, folder: str, stem: str) -> list[str]:
    """Names that an option may give: folders in `folder` with this file, in the roots of rules and in dxb."""
    places = [*(root.path for root in library.roots), OWN]
    return sorted({file.parent.name for place in places for file in place.glob(f"{folder}/*/{stem}.py")})


def of_paths(library: Library, paths: Mapping[str, Sequence[str]]) -> dict[str, tuple[Companion, ...]]:
    """Companions by slot, from the paths of each; see `RuleFacts.companions`."""
    return {slot: tuple(_of_path(library, path) for path in sorted(paths[slot])) for slot in sorted(paths)}


def _of_path(library: Library, path: str) -> Companion:
    of, _, stem = path.rpartition("/")
    return in_folder(library, of, stem) if "/" in of else beside(library.find(of), stem)


def paths_of(companions: Companions) -> dict[str, list[str]]:
    """Companions as plain data, for `of_paths`."""
    return {slot: [each.path for each in found] for slot, found in companions.items()}


def each_of(companions: Companions) -> Iterator[Companion]:
    """Every companion, in the order of its slot and path."""
    return (each for found in companions.values() for each in found)

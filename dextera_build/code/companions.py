"""Companions: files beside a rule whose code runs what the rule made, such as `policy.py` for a checkpoint.

The rule does not import its companion, so an edit of it makes stale what runs the artifact, not the artifact. The file
of a rule may itself be the companion: that of an observation term holds its declaration and its function.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import ModuleType
from typing import TypeAlias

from dextera_build.code.loader import Library, Root, RuleFile, imported

Companions: TypeAlias = Mapping[str, Mapping[str, "Companion"]]
"""Slot -> name -> companion."""


@dataclass(frozen=True)
class Companion:
    """A companion as found on disk."""

    rule: str
    """Path of a rule beside it."""
    file: Path
    root: Root

    @property
    def name(self) -> str:
        """The name of its folder, `act` of `rules/learn/act/policy.py`; of a rule's own file, the name of the rule."""
        return self.file.stem if self.own else self.file.parent.name

    @property
    def own(self) -> bool:
        """Whether it is the file of the rule itself."""
        return self.file.stem == self.rule.rpartition(".")[2]

    @cached_property
    def module(self) -> ModuleType:
        """The imported module."""
        path = self.rule if self.own else f"{self.rule.partition('.')[0]}.{self.name}.{self.file.stem}"
        return imported(self.root, path, self.file)


def beside(found: RuleFile, stem: str) -> Companion:
    """The companion of a rule in a file of this name, whether it exists or not; with an empty name its own file."""
    return Companion(found.path, found.file.with_name(f"{stem}.py") if stem else found.file, found.root)


def of_rules(library: Library, stems: Mapping[str, Mapping[str, str]]) -> Companions:
    """The companions of rules.

    Args:
        library: Provides rules.
        stems: Slot -> path of a rule -> name of the file without suffix; see `RuleFacts.companions`.
    """
    found = {slot: [beside(library.find(path), stem) for path, stem in stems[slot].items()] for slot in sorted(stems)}
    return {
        slot: {each.name: each for each in sorted(many, key=lambda each: each.name)} for slot, many in found.items()
    }


def stems(companions: Companions) -> dict[str, dict[str, str]]:
    """Companions as plain data, for `of_rules`."""
    return {
        slot: {each.rule: "" if each.own else each.file.stem for each in named.values()}
        for slot, named in companions.items()
    }


def each_of(companions: Companions) -> list[Companion]:
    """Every companion, in the order of its slot and name."""
    return [each for named in companions.values() for each in named.values()]

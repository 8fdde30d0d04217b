"""Companions: files beside a rule whose code runs what the rule made, such as `policy.py` for a checkpoint.

The rule does not import its companion, so an edit of it makes stale what runs the artifact, not the artifact.
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
        """The name of its folder: `act` of `rules/learn/act/policy.py`."""
        return self.file.parent.name

    @cached_property
    def module(self) -> ModuleType:
        """The imported module."""
        return imported(self.root, f"{self.rule.partition('.')[0]}.{self.name}.{self.file.stem}", self.file)


def beside(found: RuleFile, stem: str) -> Companion:
    """The companion of a rule in a file of this name, whether it exists or not."""
    return Companion(found.path, found.file.with_name(f"{stem}.py"), found.root)


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
    return {slot: {each.rule: each.file.stem for each in named.values()} for slot, named in companions.items()}


def each_of(companions: Companions) -> list[Companion]:
    """Every companion, in the order of its slot and name."""
    return [each for named in companions.values() for each in named.values()]

"""Deployable terms that a project adds to those of dxb."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.errors import RuleError
from dextera_build.policy.layout import Layout
from dextera_build.policy.seen import Embodied, Seen


class TermCode(Protocol):
    """Interface of the file of a term, in addition to the rule that declares it."""

    def measure(self, worlds: Seen) -> np.ndarray:
        """Values of the term in N worlds (N, rows, parts), or (N, rows) if a row is one number."""
        ...


@dataclass(frozen=True)
class AddedTerm:
    """A term that does not come with dxb."""

    spec: TermSpec
    """Its declaration."""
    measure: Callable[[Seen], np.ndarray]
    """Its function, see `TermCode`."""


def listed(terms: Collection[TermSpec] | None) -> tuple[TermSpec, ...]:
    """The terms that a rule is given in its optional input `terms`."""
    return () if terms is None else tuple(terms.items.values())


def of_specs(specs: Iterable[TermSpec], companion: Callable[[str, str, type[Any]], Any]) -> tuple[AddedTerm, ...]:
    """Terms with their functions.

    Args:
        specs: Declarations, from the input `terms` of a rule.
        companion: `Context.companion` of its call.
    """
    return tuple(AddedTerm(spec, companion("terms", spec.term, TermCode).measure) for spec in specs)


class AddedTerms:
    """The terms that are added to one task.

    Args:
        terms: Declarations and functions.
        layout: Layout of the task with these terms.
        embodied: The task's robot and objects.
    """

    def __init__(self, terms: Sequence[AddedTerm], layout: Layout, embodied: Embodied) -> None:
        self.embodied = embodied
        self.specs = tuple(term.spec for term in terms)
        """Declarations."""
        self._measures = {term.spec.term: term.measure for term in terms}
        self._shapes = {each.name: layout.shape(each) for each in layout.added}

    def values(self, worlds: Seen) -> dict[str, np.ndarray]:
        """Term -> its values (N, ...) float32.

        Raises:
            RuleError: A function returns another shape than declared.
        """
        return {name: self._checked(name, measure(worlds)) for name, measure in self._measures.items()}

    def _checked(self, name: str, found: np.ndarray) -> np.ndarray:
        value, wanted = np.asarray(found, np.float32), self._shapes[name]
        if value.shape[1:] != wanted:
            raise RuleError(
                f"`measure` of the term `{name}` returns another shape than it declares",
                code="DXB-B390",
                facts={"returned": f"{value.shape}", "declared": f"(N, {', '.join(map(str, wanted))})"},
                hint="the first axis is that of worlds; `rows` and `parts` of its `TermSpec` give the others",
            )
        return value

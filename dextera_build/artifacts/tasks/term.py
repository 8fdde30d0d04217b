"""Declarations of observation terms that are added to those of dxb."""

from __future__ import annotations

from typing import Self

from pydantic import model_validator

from dextera_build.artifacts.base import Artifact

ROWS = ("joints", "objects", "displacement", "goal", "tips", "limbs")
"""Meanings of a term's first axis."""


class TermSpec(Artifact):
    """A term that policies may see; the function `measure` in the file of its declaration computes it."""

    term: str
    """Its name, which is also that of its rule: `palm_to_object` of `rules/terms/palm_to_object.py`."""
    about: str
    """Its meaning."""
    rows: str = ""
    """Meaning of its first axis, one of `ROWS`; empty: it is one row, whose numbers `parts` names."""
    parts: tuple[str, ...] = ()
    """Names of the numbers of each row; empty: a row is one number."""
    unit: str
    """Unit of its numbers."""
    frame: str = ""
    """Frame of its numbers; empty if there is none."""

    @model_validator(mode="after")
    def _readable(self) -> Self:
        if not self.term.isidentifier():
            raise ValueError(f"`{self.term}` cannot be the name of a term; use letters, digits and `_`")
        if self.rows not in ("", *ROWS):
            raise ValueError(f"`rows` is one of {', '.join(ROWS)}, or empty, not `{self.rows}`")
        if not self.rows and not self.parts:
            raise ValueError("a term without `rows` names its numbers in `parts`")
        return self

"""The description of a JSON document that a verb prints with `--json`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Document:
    """One document: who prints it, and what its fields mean.

    A field is addressed by its path: `rows[].node` is the field `node` of each item of the list `rows`, `metrics.*` the
    value of every name in `metrics`. An object that has no field here, of type `object`, has any fields.
    """

    name: str
    """Verb and what it lists: `ls.recipes`."""
    command: str
    """The command line that prints it, without `--json`."""
    fields: Mapping[str, tuple[str, str]]
    """Path -> (type, meaning). Types are those of JSON: text, number, integer, boolean, object, list, any. `or null`
    follows where a value may be unknown or not apply, `?` where the field is absent then."""
    when: str = ""
    """When it is printed: `at its end`; "" for the only document of a command."""
    version: int = 1
    """Raised when a field changes its meaning or type, or goes; a field that is added leaves it."""

    @property
    def schema(self) -> str:
        """Value of the field `schema`: `dxb.ls.recipes/1`."""
        return f"dxb.{self.name}/{self.version}"


def rows(name: str, command: str, fields: Mapping[str, tuple[str, str]]) -> Document:
    """A document that is a list of rows; `fields` are those of a row."""
    return Document(name, command, {f"rows[].{path}": told for path, told in fields.items()})


EPOCH = "seconds since 1970-01-01 UTC"
NODE = {
    "node": ("text", "address of the node"),
    "status": (
        "text",
        "`cached` and `bare` are up to date, and the bytes of `bare` are not in the store; `stale` would run, `remote` "
        "would be fetched, `unknown` depends on one of these, `missing` cannot run on this machine",
    ),
    "rule": ("text", "address of its rule"),
    "backend": ("text or null", "backend of the rule that was chosen; null: the rule has none"),
    "last_seconds": ("number or null", "duration of its last run [s]; null: it never ran here"),
    "chosen": ("text or null", "what chose the backend"),
}
"""A row of `dxb plan` and `dxb ls RECIPE`."""
STALE = {
    "node": ("text", "address of a node that would run"),
    "why": ("text", "the first change, and the number of further ones"),
}
"""A row of stale nodes."""
ERROR = {
    "family": ("text", "first letter of the code: `U` command line, `R` recipe, ..."),
    "message": ("text", "what is wrong, in one sentence"),
    "code": ("text", "`DXB-U101` and the like, for `dxb help CODE`"),
    "where": ("list or null", "file, line and column; 0: the whole file"),
    "facts": ("object", "name -> details"),
    "hint": ("text or null", "the next step"),
}
"""An error as data."""


def below(parent: str, fields: Mapping[str, tuple[str, str]]) -> dict[str, tuple[str, str]]:
    """Fields of an object in the field `parent`."""
    return {f"{parent}.{path}": told for path, told in fields.items()}

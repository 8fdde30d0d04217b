"""Errors shown to users: a message, the place, the facts, and a next step.

A `DxbError` is printed without a traceback. Any other exception is a bug in dxb (exit code 70).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from dextera_build.redact import redact


@dataclass(frozen=True, slots=True)
class Place:
    """A position in a text file; `line` and `column` count from 1, 0 means the whole file."""

    file: str
    line: int = 0
    column: int = 0

    def __str__(self) -> str:
        """`file:line:column`, as editors read it."""
        parts = [self.file] + [str(n) for n in (self.line, self.column) if n]
        return ":".join(parts)


class DxbError(Exception):
    """An error with a stable code; subclasses fix the exit code of the command line.

    Args:
        message: One sentence without a full stop; literals in backticks.
        code: Stable name, `DXB-R104`.
        where: The place in a file that must change, if any.
        facts: Name -> value, printed one per line (sizes, units, existing names).
        hint: An action that can be pasted.
    """

    exit_code = 70
    family = "X"

    def __init__(
        self,
        message: str,
        *,
        code: str = "",
        where: Place | None = None,
        facts: Mapping[str, object] | None = None,
        hint: str | None = None,
    ) -> None:
        # Messages often contain addresses, which may hold passwords.
        self.message = redact(message)
        super().__init__(self.message)
        self.code = code or f"DXB-{self.family}000"
        self.where = where
        self.facts = {name: redact(str(value)) for name, value in (facts or {}).items()}
        self.hint = redact(hint) if hint else hint

    def __str__(self) -> str:
        """The message, then place, facts and hint on separate lines, as shown in a notebook."""
        rows = [("at", str(self.where))] if self.where else []
        rows += [*self.facts.items(), *([("hint", self.hint)] if self.hint else [])]
        return "\n".join([self.message, *(f"  {name}: {value}" for name, value in rows)])

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle as plain data."""
        return from_json, (self.to_json(),)

    def to_json(self) -> dict[str, object]:
        """Plain data to pass between processes; `from_json` restores the error."""
        where = [self.where.file, self.where.line, self.where.column] if self.where else None
        return {
            "family": self.family,
            "message": self.message,
            "code": self.code,
            "where": where,
            "facts": self.facts,
            "hint": self.hint,
        }


class UsageError(DxbError):
    """The command line is wrong (exit 2)."""

    exit_code = 2
    family = "U"


class RecipeError(DxbError):
    """A recipe, a configuration file or a declared input is wrong (exit 2)."""

    exit_code = 2
    family = "R"


class RuleError(DxbError):
    """A rule failed on its inputs: bad data, a failed check (exit 1)."""

    exit_code = 1
    family = "B"


class ArtifactError(RuleError):
    """A value does not match its declared type: shape, dtype, unit, frame, finiteness (exit 1)."""

    family = "A"


class StoreError(DxbError):
    """The store is damaged, full or not writable (exit 1)."""

    exit_code = 1
    family = "S"


class StaleError(DxbError):
    """`--check` found stale targets, or `--locked` found targets that differ from their pins (exit 3)."""

    exit_code = 3
    family = "C"


class MachineError(DxbError):
    """The machine lacks a package, a device or a permission (exit 4)."""

    exit_code = 4
    family = "E"


def from_json(data: Mapping[str, object]) -> DxbError:
    """Restore an error from `DxbError.to_json`."""
    kinds = {
        kind.family: kind
        for kind in (UsageError, RecipeError, RuleError, ArtifactError, StoreError, StaleError, MachineError)
    }
    where = data.get("where")
    place = Place(str(where[0]), int(where[1]), int(where[2])) if isinstance(where, list) else None
    facts = data.get("facts")
    hint = data.get("hint")
    kind = kinds.get(str(data.get("family")), DxbError)
    return kind(
        str(data["message"]),
        code=str(data.get("code", "")),
        where=place,
        facts=facts if isinstance(facts, Mapping) else None,
        hint=str(hint) if hint is not None else None,
    )


def interrupt_of(error: BaseException | None) -> KeyboardInterrupt | None:
    """The interrupt that an exception is or was raised for; Python wraps one that comes while a class is made."""
    while error is not None:
        if isinstance(error, KeyboardInterrupt):
            return error
        error = error.__cause__
    return None


def install_extra(extra: str) -> str:
    """The hint to install an extra; dxb is distributed as a clone or a wheel, not on a package index."""
    return f"`pip install -e '.[{extra}]'` in the clone of dxb, or `pip install 'WHEEL[{extra}]'`"


def extras_of_dxb() -> dict[str, set[str]]:
    """Extra -> the distributions that it names; empty if dxb runs from its folder without being installed."""
    import importlib.metadata
    import re

    extras: dict[str, set[str]] = {}
    try:
        declared = importlib.metadata.requires("dextera-build") or []
    except importlib.metadata.PackageNotFoundError:
        declared = []
    for line in declared:
        found = re.match(r"([\w.-]+).*extra == ['\"]([\w-]+)['\"]", line)
        if found:
            extras.setdefault(found[2], set()).add(found[1].lower().replace("_", "-"))
    return extras


def smallest_extra(distributions: Iterable[str]) -> str:
    """The extra of dxb with the fewest packages that has all of these distributions; `all` if none has."""
    extras = extras_of_dxb()
    wanted = {each.lower().replace("_", "-") for each in distributions}
    fitting = [extra for extra, packages in extras.items() if wanted <= packages]
    return min(fitting, key=lambda extra: (len(extras[extra]), extra), default="all")


def did_you_mean(name: str, known: Iterable[str], form: str = "`{}`") -> str | None:
    """The hint for an unknown name, or None if no known name is similar.

    A name that ends in the unknown one is the nearest: `factorize.mesh` for `mesh`.
    """
    near = nearest(name, known, 1, cutoff=0.6)
    return f"did you mean {form.format(near[0])}?" if near else None


def nearest(name: str, known: Iterable[str], most: int, cutoff: float = 0.0) -> list[str]:
    """The names that are most like an unknown one, the most similar first."""
    import difflib  # slow to import, and only errors need it

    names = list(known)
    ending = [each for each in names if each.endswith((f".{name}", f"/{name}"))]
    return [*ending, *difflib.get_close_matches(name, [each for each in names if each not in ending], most, cutoff)][
        :most
    ]


def listing(names: Iterable[str], most: int = 12) -> str:
    """Names for an error's facts: sorted, shortened after `most`."""
    known = sorted(names)
    more = f", and {len(known) - most} more" if len(known) > most else ""
    return ", ".join(known[:most]) + more if known else "none"

"""Artifact types in a recipe: compatible types, and the types of fields.

A type may be a union. `Any` is the type of an input that was not given: it fits everywhere and has every field.
"""

from __future__ import annotations

import re
import types
from collections.abc import Iterator
from typing import Any, Union, get_args, get_origin

from dextera_build.errors import Place, RecipeError, did_you_mean, listing


def choices(kind: Any) -> tuple[Any, ...]:
    """The types of a union without None; any other type alone."""
    if get_origin(kind) in (Union, types.UnionType):
        return tuple(choice for part in get_args(kind) if part is not type(None) for choice in choices(part))
    return (kind,)


def type_name(kind: Any) -> str:
    """A type as shown to the author of a recipe: `Collection[Asset]`, `Image | None`, `tuple[float, ...]`."""
    if kind is types.NoneType:
        return "None"
    if isinstance(kind, type) and not get_args(kind):
        inner = ", ".join(map(type_name, parameters(kind)))
        return f"{_bare(kind)}[{inner}]" if inner else kind.__name__
    if hasattr(kind, "__metadata__"):
        return type_name(kind.__origin__)
    parts = ["..." if part is Ellipsis else type_name(part) for part in get_args(kind)]
    if get_origin(kind) in (tuple, dict):
        return f"{get_origin(kind).__name__}[{', '.join(parts)}]"
    if get_origin(kind) in (Union, types.UnionType):
        return " | ".join(parts)
    return re.sub(r"[A-Za-z_][\w.]*\.(\w+)", r"\1", str(kind)).replace("~", "")


def fits(wanted: Any, given: Any) -> bool:
    """Whether every artifact of type `given` is one of type `wanted`."""
    return all(any(_is(given_choice, choice) for choice in choices(wanted)) for given_choice in choices(given))


def overlap(one: Any, other: Any) -> bool:
    """Whether an artifact can be of both types."""
    return any(_is(a, b) or _is(b, a) for a in choices(one) for b in choices(other))


def _is(given: Any, wanted: Any) -> bool:
    if given is Any:
        return True
    inner, wanted_inner = parameters(given), parameters(wanted)
    if inner and wanted_inner:
        return _bare(given) == _bare(wanted) and fits(wanted_inner[0], inner[0])
    # Two mounts of one file create two classes, so types are compared by name.
    names = [base.__name__ for base in getattr(given, "__mro__", (given,))]
    return wanted.__name__ in names or wanted.__name__ == "Artifact"


def parameters(kind: Any) -> tuple[Any, ...]:
    """`(Asset,)` of `Collection[Asset]`; () of a type without parameters."""
    return tuple(getattr(kind, "__pydantic_generic_metadata__", {}).get("args") or ())


def _bare(kind: Any) -> str:
    return str(kind.__name__).partition("[")[0]


def field_type(kind: Any, fields: tuple[str, ...], where: Place) -> Any:
    """The artifact type that a path of fields leads to; of a union, every choice must have them.

    Raises:
        RecipeError: There is no such field, or it is not an artifact.
    """
    from dextera_build.artifacts.base import Artifact

    if kind is Any:
        return Any
    found = list(dict.fromkeys(_reached(kind, fields, where)))
    use = "shown or written alone" if where.file == "the command line" else "inputs"
    for each in found:
        if not (isinstance(each, type) and issubclass(each, Artifact)):
            raise RecipeError(
                f"`{'.'.join(fields)}` is {type_name(each)}, not an artifact, and only artifacts can be {use}",
                code="DXB-R107",
                where=where,
            )
    return Union[tuple(found)]  # noqa: UP007 - as many as there are


def _reached(kind: Any, fields: tuple[str, ...], where: Place) -> Iterator[Any]:
    for choice in choices(kind):
        if not fields:
            yield choice
        elif get_origin(choice) is dict:
            yield from _reached(get_args(choice)[1], fields[1:], where)
        elif fields[0] in (known := getattr(choice, "model_fields", {})):
            yield from _reached(known[fields[0]].annotation, fields[1:], where)
        else:
            raise RecipeError(
                f"{type_name(choice)} has no `{fields[0]}`",
                code="DXB-R107",
                where=where,
                facts={"it has": listing(known)},
                hint=did_you_mean(fields[0], known),
            )

"""Check the options of a call against the declaration of its rule or its backend."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Container, Iterator, Mapping, Sequence
from typing import Any, get_args, get_origin

from dextera_build.errors import Place, RecipeError, did_you_mean, listing
from dextera_build.recipe.kinds import choices
from dextera_build.recipe.schema import CallDecl
from dextera_build.recipe.strict_yaml import Node

_BOUNDS = ("greater_than", "greater_than_equal", "less_than", "less_than_equal")
_UNIT = re.compile(r"\[([^\[\]]+)\]")
"""The unit in an option's docstring: `Wall thickness of a vessel [m].`"""


def checked(decl: CallDecl, kind: Any, given: Node, group: str = "", node: str = "NODE") -> dict[str, Any]:
    """The options of a rule, or of its backend `group`, complete with defaults.

    Args:
        decl: The call.
        kind: Its class of options.
        given: Mapping from option to value.
        group: Name of the backend; empty for the rule's own options.
        node: Address of the call, for the hint.

    Raises:
        RecipeError: The first value that does not fit, with its place.
    """
    from pydantic import ValidationError

    from dextera_build.recipe import limits  # imports pydantic, too

    plain = given.plain()
    try:
        # JSON mode accepts a list for a tuple and 1 for 1.0, and is otherwise strict.
        options = kind.model_validate_json(json.dumps(plain))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        location = tuple(first["loc"]) or _named(first["msg"], given.value)
        if first["type"] == "extra_forbidden":
            raise _unknown(decl, kind, given, group, location) from None
        if first["type"] == "missing":
            raise _needed(decl, kind, group, location, node) from None
        where = given.at(location) if location and location[0] in given.value else decl.place
        value = plain[location[0]] if not first["loc"] and location else first["input"]
        raise _wrong(decl, kind, group, location, _demand(first, location, kind), where, value) from None
    above = limits.exceeded(options)
    if above is not None:
        path, number, limit = above
        demand = f"must be {'at most' if number > 0 else 'at least'} {math.copysign(limit, number):g}"
        raise _wrong(decl, kind, group, path, demand + _unit(path, kind), given.at(path), number)
    dumped: dict[str, Any] = options.model_dump(mode="json")
    return dumped


def _wrong(
    decl: CallDecl, kind: Any, group: str, location: tuple[Any, ...], demand: str, where: Place, value: object
) -> RecipeError:
    """The error for a value that does not fit."""
    name = str(location[0]) if location else ""
    text = _meanings(kind).get(name)
    option = ".".join(str(part) for part in ((group,) if group else ()) + location)
    return RecipeError(
        f"{f'`{option}` of ' if option else ''}`{decl.rule}` {demand}",
        code="DXB-R109",
        where=where,
        facts={"given": repr(value)[:120]},
        hint=f"`{name}`: {text}" if text else None,
    )


def _needed(decl: CallDecl, kind: Any, group: str, location: tuple[Any, ...], node: str) -> RecipeError:
    """The error for an option without a default that is not given."""
    option = ".".join(map(str, [*([group] if group else []), *location]))
    text = _meanings(kind).get(str(location[0])) if len(location) == 1 else None
    return RecipeError(
        f"`{decl.rule}` needs the option `{option}`",
        code="DXB-R117",
        where=decl.place,
        facts={"it is": text} if text else None,
        hint=f"`--set '{node}.{option}=VALUE'`, or the option at the node in the recipe",
    )


def _unknown(decl: CallDecl, kind: Any, given: Node, group: str, location: tuple[Any, ...]) -> RecipeError:
    """The error for an option that does not exist, at its name."""
    *above, name = location
    known = [field for each in _classes(kind, above) for field in each.model_fields]
    path = ".".join(map(str, [*([group] if group else []), *above]))
    return RecipeError(
        f"{f'`{path}` of ' if path else ''}`{decl.rule}` has no option `{name}`",
        code="DXB-R105",
        where=given.key(location),
        facts={"options": listing(known, most=40)},
        hint=did_you_mean(str(name), known),
    )


def _classes(kind: Any, path: Sequence[Any]) -> list[Any]:
    """The classes of options that a path of names, labels and indices may lead to."""
    found = list(_bare(kind))
    for step in path:  # a union's tag is a step that leads nowhere
        found = [inner for each in found for inner in _below(each, step)] or found
    return [each for each in found if hasattr(each, "model_fields")]


def _below(kind: Any, step: Any) -> Iterator[Any]:
    if get_origin(kind) in (dict, tuple):
        yield from _bare(next(part for part in reversed(get_args(kind)) if part is not Ellipsis))
    elif step in getattr(kind, "model_fields", {}):
        yield from _bare(kind.model_fields[step].annotation)


def _bare(kind: Any) -> Iterator[Any]:
    """The types of a union, without their constraints."""
    for each in choices(kind):
        yield from _bare(each.__origin__) if hasattr(each, "__metadata__") else (each,)


def _named(message: str, given: Container[str]) -> tuple[str, ...]:
    """The given option that a message about several options names first."""
    return next(((name,) for name in re.findall(r"`(\w+)`", message) if name in given), ())


def _meanings(kind: Any) -> dict[str, str]:
    from dextera_build.artifacts.core.field_docs import field_docs

    return field_docs(kind)


def _demand(error: Mapping[str, Any], location: tuple[Any, ...], kind: Any) -> str:
    """Pydantic's requirement as the end of a sentence, bounds with their unit: `must be greater than 0 m`."""
    text = str(error["msg"]).removeprefix("Value error, ").replace("Input should", "must", 1)
    unit = _unit(location, kind) if error["type"] in _BOUNDS else ""
    return (text if text.startswith("must") else f"is refused: {text}") + unit


def _unit(location: tuple[Any, ...], kind: Any) -> str:
    """The unit of an option, after a space."""
    unit = _UNIT.search(_meanings(kind).get(location[0], "")) if len(location) == 1 else None
    return f" {unit[1]}" if unit else ""

"""Check the options of a call against what its rule or its backend declares."""

from __future__ import annotations

import json
import re
from collections.abc import Container, Iterator, Mapping, Sequence
from typing import Any, get_args, get_origin

from dextera_build.errors import RecipeError, did_you_mean, listing
from dextera_build.recipe.kinds import choices
from dextera_build.recipe.schema import CallDecl
from dextera_build.recipe.strict_yaml import Node

_BOUNDS = ("greater_than", "greater_than_equal", "less_than", "less_than_equal")
_UNIT = re.compile(r"\[([^\[\]]+)\]")
"""The unit in an option's docstring: `Wall thickness of a vessel [m].`"""


def checked(decl: CallDecl, kind: Any, given: Node, group: str = "") -> dict[str, Any]:
    """The options of a rule, or of its backend `group`, complete with defaults.

    Args:
        decl: The call.
        kind: Its class of options.
        given: Mapping from option to value.
        group: Name of the backend; empty for the rule's own options.

    Raises:
        RecipeError: The first value that does not fit, with its place.
    """
    from pydantic import ValidationError

    plain = given.plain()
    try:
        # JSON mode accepts a list for a tuple and 1 for 1.0, and is otherwise strict.
        options = kind.model_validate_json(json.dumps(plain))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        location = tuple(first["loc"]) or _named(first["msg"], given.value)
        if first["type"] == "extra_forbidden":
            raise _unknown(decl, kind, given, group, location) from None
        name = str(location[0]) if location else ""
        where = given.at(location) if name in given.value else decl.place
        text = _meanings(kind).get(name)
        option = ".".join(str(part) for part in ((group,) if group else ()) + location)
        value = plain[name] if not first["loc"] and name else first["input"]
        raise RecipeError(
            f"{f'`{option}` of ' if option else ''}`{decl.rule}` {_demand(first, text or '')}",
            code="DXB-R109",
            where=where,
            facts={"given": repr(value)[:120]},
            hint=f"`{name}`: {text}" if text else None,
        ) from None
    dumped: dict[str, Any] = options.model_dump(mode="json")
    return dumped


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
    from dextera_build.artifacts.meanings import meanings

    return meanings(kind)


def _demand(error: Mapping[str, Any], meaning: str) -> str:
    """Pydantic's requirement as the end of a sentence, bounds with their unit: `must be greater than 0 m`."""
    text = str(error["msg"]).removeprefix("Value error, ").replace("Input should", "must", 1)
    unit = _UNIT.search(meaning) if error["type"] in _BOUNDS and len(error["loc"]) == 1 else None
    return (text if text.startswith("must") else f"is refused: {text}") + (f" {unit[1]}" if unit else "")

"""Check the options of a call against what its rule or its backend declares."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

from dextera_build.errors import RecipeError
from dextera_build.recipe.schema import CallDecl
from dextera_build.recipe.strict_yaml import Node

_BOUNDS = ("greater_than", "greater_than_equal", "less_than", "less_than_equal")
_UNIT = re.compile(r"\[([^\[\]]+)\]")
"""The unit in an option's docstring: `Wall thickness of a vessel [m].`"""


def checked(decl: CallDecl, kind: Any, given: Mapping[str, Node], group: str = "") -> dict[str, Any]:
    """The options of a rule, or of its backend `group`, complete with defaults.

    Args:
        decl: The call.
        kind: Its class of options.
        given: Option -> value with its place.
        group: Name of the backend; empty for the rule's own options.

    Raises:
        RecipeError: The first value that does not fit, with its place.
    """
    from pydantic import ValidationError

    plain = {name: node.plain() for name, node in given.items()}
    try:
        # JSON mode accepts a list for a tuple and 1 for 1.0, and is otherwise strict.
        options = kind.model_validate_json(json.dumps(plain))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        location = tuple(first["loc"]) or _named(first["msg"], given)
        name = str(location[0]) if location else ""
        where = given[name].at(location[1:]) if name in given else decl.place
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


def _named(message: str, given: Mapping[str, Node]) -> tuple[str, ...]:
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

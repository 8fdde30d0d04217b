"""The options of a rule's backends: those of the chosen one, and what is wrong in those of the others."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dextera_build.code.loader import BackendFile, RuleFile
from dextera_build.errors import RecipeError, listing
from dextera_build.recipe.backends import Choice
from dextera_build.recipe.option_values import checked
from dextera_build.recipe.schema import CallDecl
from dextera_build.recipe.strict_yaml import Node

_WRONG = ("DXB-R105", "DXB-R109")
"""Codes of a wrong name and of a wrong value."""


def of_chosen(
    decl: CallDecl, found: RuleFile, choice: Choice, given: Mapping[str, Node], node: str
) -> dict[str, dict[str, Any]]:
    """The options of the chosen backend by its name, complete with defaults.

    The options of others are checked as far as these can be imported.

    Args:
        decl: The call.
        found: Its rule.
        choice: The chosen backend.
        given: Name of a backend -> its options in the recipe or on the command line.
        node: Address of the call, for hints.

    Returns:
        Nothing if it has no options, or cannot be imported because something is missing.

    Raises:
        RecipeError: An option does not exist or does not fit.
    """
    for name in sorted(given.keys() & found.backends.keys() - {choice.backend.name}):
        try:
            if not found.backends[name].missing():
                _of(decl, found, found.backends[name], given, node)
        except RecipeError as error:
            if error.code in _WRONG:  # what else it lacks, and what is wrong in its file, matters once it is chosen
                raise
    own = None if choice.missing else _of(decl, found, choice.backend, given, node)
    return {} if own is None else {choice.backend.name: own}


def _of(
    decl: CallDecl, found: RuleFile, backend: BackendFile, given: Mapping[str, Node], node: str
) -> dict[str, Any] | None:
    """The options of a backend that can be imported; None if it has none."""
    name, kind = backend.name, backend.options
    group = given.get(name)
    if kind is None and group is None:
        return None
    if kind is None:
        raise RecipeError(
            f"backend `{name}` of `{decl.rule}` has no options",
            code="DXB-R105",
            where=given[name].place,
            facts={"options of the rule": listing(found.rule.options.model_fields, most=40)},
        )
    if group is not None and not isinstance(group.value, dict):
        text = f"`{name}` of `{decl.rule}` is a mapping of options, this is {group.kind}"
        raise RecipeError(text, code="DXB-R109", where=group.place)
    return checked(decl, kind, group or Node({}, decl.place), name, node)


def hint(name: str, backends: Mapping[str, BackendFile], node: str = "") -> str | None:
    """The hint for an option that belongs to a backend, as the recipe spells it, or `--set` of a node."""
    for backend in backends.values():
        kind = None if backend.missing() else backend.options
        if kind is not None and name in kind.model_fields:
            form = f"--set '{node}.{backend.name}.{name}=VALUE'" if node else f"{backend.name}: {{{name}: ...}}"
            return f"it is an option of a backend: `{form}`"
    return None

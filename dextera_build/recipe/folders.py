"""Options that name a folder of code, such as `primitive: lift`, with their groups of options: `lift: {...}`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from dextera_build.code.companions import Companion, in_folder, names_in
from dextera_build.code.loader import Library, RuleFile
from dextera_build.errors import Place, RecipeError, did_you_mean, listing
from dextera_build.recipe.option_values import checked
from dextera_build.recipe.schema import CallDecl
from dextera_build.recipe.strict_yaml import Node


def named(library: Library, decl: CallDecl, found: RuleFile, arguments: Mapping[str, Node]) -> dict[str, Companion]:
    """Option -> the file in the folder that it names.

    Raises:
        RecipeError: There is no such folder.
    """
    made = {}
    for option, folder in found.rule.folders.items():
        node = arguments.get(option)
        name = node.value if node is not None else found.rule.options.model_fields[option].default
        if not isinstance(name, str):
            continue  # the check of the rule's options refuses it
        companion = in_folder(library, f"{folder}/{name}", option) if name.isidentifier() else None
        library.asked.update([str(companion.file)] if companion else [])
        if companion is None or not companion.file.is_file():
            known = names_in(library, folder, option)
            raise RecipeError(
                f"no {option} is called `{name}`",
                code="DXB-R217",
                where=node.place if node is not None else decl.place,
                facts={folder: listing(known, most=40)},
                hint=did_you_mean(name, known) or f"`rules/{folder}/{name}/{option}.py` in the project adds it",
            )
        made[option] = companion
    return made


def options(decl: CallDecl, companion: Companion, given: Node | None) -> dict[str, Any]:
    """The options of a named folder, complete with defaults.

    Raises:
        RecipeError: Its file defines none, or a value does not fit.
    """
    kind = kind_of(companion)
    if given is not None and not isinstance(given.value, dict):
        raise RecipeError(
            f"`{companion.name}` of `{decl.rule}` is a mapping of options, this is {given.kind}",
            code="DXB-R109",
            where=given.place,
        )
    return checked(decl, kind, given or Node({}, decl.place), companion.name)


def kind_of(companion: Companion) -> Any:
    """The class of options of a named folder.

    Raises:
        RecipeError: Its file defines none.
    """
    kind = getattr(companion.module, "Options", None)
    if kind is None:
        raise RecipeError(f"{companion} defines no class `Options`", code="DXB-R218", where=Place(str(companion.file)))
    return kind


def every(library: Library, found: RuleFile) -> Iterator[tuple[str, Companion]]:
    """Every option that names a folder, with the file in each folder that it may name."""
    for option, folder in found.rule.folders.items():
        for name in names_in(library, folder, option):
            yield option, in_folder(library, f"{folder}/{name}", option)


def hint(library: Library, found: RuleFile, companions: Mapping[str, Companion], name: str) -> str | None:
    """The hint for an option that belongs to a folder that is named, or to another one."""
    for option, companion in companions.items():
        if name in kind_of(companion).model_fields:
            return f"it is an option of `{option}: {companion.name}`: `{companion.name}: {{{name}: ...}}`"
        if name in names_in(library, found.rule.folders[option], option):
            return f"these are options of `{option}: {name}`, not of `{option}: {companion.name}`"
    return None

"""The rules' reference, from the rules themselves: docstrings, inputs, options, backends."""

from __future__ import annotations

import inspect
from itertools import groupby

from dextera_build.code.loader import Library, RuleFile
from dextera_build.explain.rule_card import Option, options
from dextera_build.recipe.folders import every, kind_of
from dextera_build.recipe.kinds import type_name

from .markdown import code, join, table

FOLDER = "rules"
"""Folder of the pages of rules below the docs."""


def page() -> str:
    """One table per stage, of links to the pages of its rules."""
    stages = groupby(_sorted(Library()), key=lambda found: found.path.partition(".")[0])
    return join(*(join(f"## {stage}", _overview(list(rules))) for stage, rules in stages))


def pages() -> dict[str, str]:
    """Path of a rule -> its page."""
    library = Library()
    return {found.path: _page(library, found) for found in _sorted(library)}


def _sorted(library: Library) -> list[RuleFile]:
    return sorted(library.rules(), key=lambda found: found.path)


def _overview(rules: list[RuleFile]) -> str:
    rows = [[f"[{code(found.path)}]({FOLDER}/{found.path}.md)", found.rule.summary, _names(found)] for found in rules]
    return table(["rule", "description", "backends"], rows)


def _page(library: Library, found: RuleFile) -> str:
    rule = found.rule
    slots = [
        [code(slot.name), code(type_name(slot.annotation)), "optional" if slot.optional else ""]
        for slot in rule.slots.values()
    ]
    backends = [
        [code(name), backend.facts.summary, ", ".join(map(code, backend.facts.profiles)), code(backend.facts.extra)]
        for name, backend in found.backends.items()
    ]
    needs = f", packages {', '.join(map(code, rule.packages))}" if rule.packages else ""
    return join(
        f"# {found.path}",
        _prose(inspect.getdoc(rule.function) or ""),
        f"Returns {code(type_name(rule.returns))}. Version {rule.version}{needs}.",
        table(["input", "type", ""], slots),
        table(["option", "type", "default", "meaning"], [_row(option) for option in options(rule.options)]),
        *(
            table([f"option with `{named}: {file.name}`", "type", "default", "meaning"], rows)
            for named, file in every(library, found)
            if (rows := [_row(option) for option in options(kind_of(file), f"{file.name}.")])
        ),
        table(["backend", "description", "profiles", "extra"], backends),
    )


def _row(option: Option) -> list[str]:
    form = ", ".join(map(code, filter(None, (option.type, option.bounds))))
    return [code(option.name), form, code(option.default) if option.has_default else option.default, option.meaning]


def _names(found: RuleFile) -> str:
    return ", ".join(code(name) for name in found.backends)


def _prose(text: str) -> str:
    """A Google docstring as Markdown: its sections become definition lists of one level."""
    lines = []
    for line in text.split("\n"):
        bare = line.strip()
        lines.append(f"**{bare[:-1]}**\n" if bare in {"Args:", "Returns:", "Raises:", "Yields:"} else bare)
    return "\n".join(lines)

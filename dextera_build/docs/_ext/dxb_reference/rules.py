"""The rules' reference, from the rules themselves: docstrings, inputs, options, backends."""

from __future__ import annotations

import inspect
from itertools import groupby

from dextera_build.code.loader import Library, RuleFile
from dextera_build.explain.rule_card import Option, options
from dextera_build.recipe.folders import every, kind_of
from dextera_build.recipe.kinds import type_name

from .markdown import code, join, table


def page() -> str:
    """One section per stage, one below it per rule."""
    library = Library()
    found = sorted(library.rules(), key=lambda rule: rule.path)
    overview = table(
        ["rule", "description", "backends"],
        [[f"[{code(r.path)}](#{r.path.replace('.', '-')})", r.rule.summary, _names(r)] for r in found],
    )
    stages = groupby(found, key=lambda rule: rule.path.partition(".")[0])
    return join(
        overview, *(join(f"## {stage}", *(section(library, rule) for rule in rules)) for stage, rules in stages)
    )


def section(library: Library, found: RuleFile) -> str:
    """One rule."""
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
        f"({found.path.replace('.', '-')})=\n### {found.path}",
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

"""The rules' reference, from the rules themselves: docstrings, inputs, options, backends."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from itertools import groupby
from types import UnionType
from typing import Any, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from dextera_build.artifacts.meanings import bounds, meanings
from dextera_build.code.loader import Library, RuleFile

from .markdown import code, join, table


def page() -> str:
    """One section per stage, one below it per rule."""
    found = sorted(Library().rules(), key=lambda rule: rule.path)
    overview = table(
        ["rule", "what it does", "backends"],
        [[f"[{code(r.path)}](#{r.path.replace('.', '-')})", r.rule.summary, _names(r)] for r in found],
    )
    stages = groupby(found, key=lambda rule: rule.path.partition(".")[0])
    return join(overview, *(join(f"## {stage}", *(section(rule) for rule in rules)) for stage, rules in stages))


def section(found: RuleFile) -> str:
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
        table(["option", "type", "default", "meaning"], list(options(rule.options))),
        table(["backend", "what it does", "profiles", "extra"], backends),
    )


def options(kind: type[BaseModel], prefix: str = "") -> Iterator[list[str]]:
    """Rows of an options class; fields of nested groups stand below them as `group.field`."""
    said = meanings(kind)
    for name, field in kind.model_fields.items():
        form = ", ".join(filter(None, (code(type_name(field.annotation)), code(bounds(field)))))
        yield [code(prefix + name), form, _default(field), said.get(name, "")]
        for inner in _groups(field.annotation):
            yield from options(inner, f"{prefix}{name}.")


def type_name(annotation: Any) -> str:
    """A type as a recipe's author reads it: `Collection[Asset]`, `tuple[float, ...]`."""
    if isinstance(annotation, type) and not get_args(annotation):
        return annotation.__name__
    if hasattr(annotation, "__metadata__"):
        return type_name(annotation.__origin__)
    parts = ["..." if part is Ellipsis else type_name(part) for part in get_args(annotation)]
    if get_origin(annotation) in (tuple, dict):
        return f"{get_origin(annotation).__name__}[{', '.join(parts)}]"
    if get_origin(annotation) in (Union, UnionType):
        return " | ".join(parts)
    return re.sub(r"[A-Za-z_][\w.]*\.(\w+)", r"\1", str(annotation)).replace("NoneType", "None").replace("~", "")


def _names(found: RuleFile) -> str:
    return ", ".join(code(name) for name in found.backends)


def _groups(annotation: Any) -> list[type[BaseModel]]:
    parts = get_args(annotation) or (annotation,)
    return [part for part in parts if isinstance(part, type) and issubclass(part, BaseModel)]


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    value = field.get_default(call_default_factory=True)
    if value is PydanticUndefined or isinstance(value, BaseModel):
        return ""
    return code(f'"{value}"' if isinstance(value, str) else value)


def _prose(text: str) -> str:
    """A Google docstring as Markdown: its sections become definition lists of one level."""
    lines = []
    for line in text.split("\n"):
        bare = line.strip()
        lines.append(f"**{bare[:-1]}**\n" if bare in {"Args:", "Returns:", "Raises:", "Yields:"} else bare)
    return "\n".join(lines)

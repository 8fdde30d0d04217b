"""The interface of a rule: inputs, options with bounds and defaults, backends with their needs."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, get_args

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined, to_jsonable_python

from dextera_build.artifacts.core.field_docs import bounds, field_docs
from dextera_build.code.loader import BackendFile, Library, RuleFile
from dextera_build.recipe.folders import every, kind_of
from dextera_build.recipe.kinds import type_name
from dextera_build.recipe.limits import of_unit

Row = dict[str, str]


@dataclass(frozen=True)
class Option:
    """An option of a rule, as text."""

    name: str
    """Fields of nested groups are `group.field`."""
    type: str
    bounds: str
    default: str
    """`required` if there is none, "" for a group."""
    meaning: str
    """With its unit."""
    value: Any = None
    """The default as JSON data; None if there is none, or for a group."""

    @property
    def has_default(self) -> bool:
        """Whether `default` is a value."""
        return self.default not in ("", "required")


def rows(library: Library, found: RuleFile) -> list[Row]:
    """A rule as rows of a table: kind, name, type, default, bounds, meaning."""
    rule = found.rule
    told = [_row("rule", found.path, f"version {rule.version}", meaning=rule.summary)]
    told += [
        _row("input", slot.name, type_name(slot.annotation), "optional" if slot.optional else "required")
        for slot in rule.slots.values()
    ]
    told.append(_row("output", "", type_name(rule.returns)))
    for option in options(rule.options):
        told.append(_row("option", option.name, option.type, option.default, option.bounds, option.meaning))
    for named, file in every(library, found):
        told.append(_row(named, file.name, "", meaning=(file.module.__doc__ or "").partition("\n")[0]))
        for option in options(kind_of(file), f"{file.name}."):
            told.append(_row("option", option.name, option.type, option.default, option.bounds, option.meaning))
    for name, backend in found.backends.items():
        told.append(_row("backend", name, _needs(backend), meaning=backend.facts.summary))
        own = None if backend.missing() else backend.options
        for option in options(own, f"{name}.") if own is not None else ():
            told.append(_row("option", option.name, option.type, option.default, option.bounds, option.meaning))
    return told


def card(library: Library, found: RuleFile) -> dict[str, Any]:
    """The same as data: the document `show.rule`."""
    rule = found.rule
    return {
        "rule": found.path,
        "version": rule.version,
        "summary": " ".join(rule.summary.split()),
        "inputs": [
            {"name": slot.name, "type": type_name(slot.annotation), "required": not slot.optional}
            for slot in rule.slots.values()
        ],
        "output": type_name(rule.returns),
        "options": _plain(rule.options),
        "files": [
            {
                "kind": named,
                "name": file.name,
                "summary": (file.module.__doc__ or "").partition("\n")[0],
                "options": _plain(kind_of(file), f"{file.name}."),
            }
            for named, file in every(library, found)
        ],
        "backends": [_backend(name, backend) for name, backend in found.backends.items()],
    }


def _backend(name: str, backend: BackendFile) -> dict[str, Any]:
    facts, missing = backend.facts, list(backend.missing())
    own = None if missing else backend.options
    return {
        "name": name,
        "profiles": list(facts.profiles),
        "extra": facts.extra or None,
        "gpu_gb": facts.gpu_gb or None,
        "weights": [weights.partition("@")[0] for weights in facts.weights],
        "lacks": missing,
        "summary": facts.summary,
        "options": _plain(own, f"{name}.") if own is not None else [],
    }


def _plain(kind: type[BaseModel], prefix: str = "") -> list[dict[str, Any]]:
    return [
        {
            "name": option.name,
            "type": option.type,
            "required": option.default == "required",
            "default": option.value,
            "bounds": option.bounds or None,
            "meaning": " ".join(option.meaning.split()),
        }
        for option in options(kind, prefix)
    ]


def narrow(rows: list[Row]) -> list[Row]:
    """The same in three columns: what it is; type, default with its unit and bounds, one per line; meaning."""
    return [
        {
            "name": row["name"] if row["kind"] == "option" else f"{row['kind']} {row['name']}".strip(),
            "value": "\n".join(_value(row)),
            "meaning": row["meaning"],
        }
        for row in rows
    ]


def _value(row: Row) -> Iterator[str]:
    unit = re.search(r"\[([^\[\]]+)\]", row["meaning"]) if row["kind"] == "option" else None
    yield from filter(None, [row["type"]])
    yield from filter(None, [row["default"]] if row["kind"] == "input" else [])
    if row["kind"] == "option" and row["default"]:
        has_unit = unit is not None and row["default"] != "required"
        yield f"= {row['default']}{f' {unit[1]}' if has_unit and unit else ''}"
    yield from filter(None, [row["bounds"]])


def _row(kind: str, name: str, form: str, default: str = "", limits: str = "", meaning: str = "") -> Row:
    meaning = " ".join(meaning.split())
    return {"kind": kind, "name": name, "type": form, "default": default, "bounds": limits, "meaning": meaning}


def _needs(backend: BackendFile) -> str:
    """Profiles that select a backend, and its requirements."""
    facts, missing = backend.facts, backend.missing()
    told = [", ".join(facts.profiles) or "no profile"]
    told += [f"extra {facts.extra}"] if facts.extra else []
    told += [f"{facts.gpu_gb:g} GiB of GPU memory"] if facts.gpu_gb else []
    told += [f"weights {', '.join(weights.partition('@')[0] for weights in facts.weights)}"] if facts.weights else []
    told += [f"not installed: {', '.join(missing)}"] if missing else []
    return "; ".join(told)


def options(kind: type[BaseModel], prefix: str = "") -> Iterator[Option]:
    """The fields of an options class; those of nested groups follow the group as `group.field`."""
    said = field_docs(kind)
    for name, field in kind.model_fields.items():
        form = type_name(field.annotation)
        value = to_jsonable_python(_value_of(field))
        yield Option(prefix + name, form, _bounds(name, field), _default(field), said.get(name, ""), value)
        for inner in _groups(field.annotation):
            yield from options(inner, f"{prefix}{name}.")


def _bounds(name: str, field: FieldInfo) -> str:
    """Declared bounds, and the upper limit that planning adds to a quantity with a unit that has none."""
    limit = of_unit(name, field) if re.search(r"\b(int|float)\b", str(field.annotation)) else None
    return ", ".join([*filter(None, [bounds(field)]), *([f"<= {limit:g}"] if limit is not None else [])])


def _groups(annotation: Any) -> list[type[BaseModel]]:
    parts = get_args(annotation) or (annotation,)
    return [part for part in parts if isinstance(part, type) and issubclass(part, BaseModel)]


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    value = field.get_default(call_default_factory=True)
    if value is PydanticUndefined or isinstance(value, BaseModel):
        return ""
    return f'"{value}"' if isinstance(value, str) else str(value)


def _value_of(field: FieldInfo) -> Any:
    """The default; None for a group, whose fields have their own."""
    value = None if field.is_required() else field.get_default(call_default_factory=True)
    return None if value is PydanticUndefined or isinstance(value, BaseModel) else value

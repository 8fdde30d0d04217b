"""The fields of artifact types: name, type with shape, unit and frame, meaning."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from collections.abc import Iterator
from types import ModuleType
from typing import TypeAlias

from pydantic.fields import FieldInfo

from dextera_build import artifacts
from dextera_build.artifacts.base import Artifact, Value
from dextera_build.artifacts.core.field_docs import field_docs
from dextera_build.artifacts.core.frames import Frames
from dextera_build.artifacts.core.schema import array_specs
from dextera_build.recipe.kinds import type_name

Kind: TypeAlias = type[Artifact] | type[Value]


def modules() -> Iterator[ModuleType]:
    """The modules of dxb that define types."""
    for module in pkgutil.walk_packages(artifacts.__path__, f"{artifacts.__name__}."):
        yield importlib.import_module(module.name)


def types(module: ModuleType) -> list[Kind]:
    """The types that a module defines, with at least one field."""
    return [
        kind
        for kind in vars(module).values()
        if inspect.isclass(kind) and kind.__module__ == module.__name__ and issubclass(kind, Artifact | Value)
        if kind.model_fields
    ]


def named() -> dict[str, Kind]:
    """Name -> type of dxb."""
    return {kind.__name__: kind for module in modules() for kind in types(module)}


def fields(kind: Kind) -> Iterator[tuple[str, str, str]]:
    """Name, type and meaning of each field."""
    arrays, said = array_specs(kind), field_docs(kind)
    for name, field in kind.model_fields.items():
        yield name, arrays[name].describe() if name in arrays else _type(field), said.get(name, "")


def rows(kind: Kind) -> list[dict[str, str]]:
    """A type as rows of a table: kind, name, type, meaning; the first row is the type with its module."""
    about = (inspect.getdoc(kind) or "").partition("\n")[0]
    found = [("type", kind.__name__, kind.__module__, about), *(("field", *field) for field in fields(kind))]
    return [dict(zip(("kind", "name", "type", "meaning"), map(_line, row), strict=True)) for row in found]


def _type(field: FieldInfo) -> str:
    frames = [mark.describe() for mark in field.metadata if isinstance(mark, Frames)]
    return " ".join([type_name(field.annotation), *frames])


def _line(text: str) -> str:
    return " ".join(text.split())

"""The artifacts' reference, from the types: fields with shape, dtype, unit and frame."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from types import ModuleType

from pydantic.fields import FieldInfo

from dextera_build import artifacts
from dextera_build.artifacts.base import Artifact, Value
from dextera_build.artifacts.core.field_docs import field_docs
from dextera_build.artifacts.core.frames import Frames
from dextera_build.artifacts.core.schema import array_specs
from dextera_build.recipe.kinds import type_name

from .markdown import code, join, table


def page() -> str:
    """One section per module of types."""
    names = [module.name for module in pkgutil.walk_packages(artifacts.__path__, f"{artifacts.__name__}.")]
    return join(*(_module(importlib.import_module(name)) for name in names))


def _module(module: ModuleType) -> str:
    kinds = [
        kind
        for kind in vars(module).values()
        if inspect.isclass(kind) and kind.__module__ == module.__name__ and issubclass(kind, Artifact | Value)
    ]
    shown = [_kind(kind) for kind in kinds if kind.model_fields]
    if not shown:
        return ""
    about = (module.__doc__ or "").partition("\n")[0]
    return join(f"## {module.__name__.removeprefix(artifacts.__name__ + '.')}", about, *shown)


def _type(field: FieldInfo) -> str:
    frames = [mark.describe() for mark in field.metadata if isinstance(mark, Frames)]
    return " ".join([type_name(field.annotation), *frames])


def _kind(kind: type[Artifact] | type[Value]) -> str:
    arrays, said = array_specs(kind), field_docs(kind)
    rows = [
        [
            code(name),
            code(arrays[name].describe() if name in arrays else _type(field)),
            said.get(name, ""),
        ]
        for name, field in kind.model_fields.items()
    ]
    stored = "" if issubclass(kind, Artifact) else " (stored inline)"
    return join(f"### {kind.__name__}{stored}", inspect.getdoc(kind) or "", table(["field", "type", "meaning"], rows))

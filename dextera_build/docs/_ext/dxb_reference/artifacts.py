"""The artifacts' reference, from the types: fields with shape, dtype, unit and frame."""

from __future__ import annotations

import inspect
from types import ModuleType

from dextera_build import artifacts
from dextera_build.artifacts.base import Artifact
from dextera_build.explain import type_card

from .markdown import code, join, table


def page() -> str:
    """One section per module of types."""
    return join(*map(_module, type_card.modules()))


def _module(module: ModuleType) -> str:
    shown = [_kind(kind) for kind in type_card.types(module)]
    if not shown:
        return ""
    about = (module.__doc__ or "").partition("\n")[0]
    return join(f"## {module.__name__.removeprefix(artifacts.__name__ + '.')}", about, *shown)


def _kind(kind: type_card.Kind) -> str:
    rows = [[code(name), code(form), meaning] for name, form, meaning in type_card.fields(kind)]
    stored = "" if issubclass(kind, Artifact) else " (stored inline)"
    return join(f"### {kind.__name__}{stored}", inspect.getdoc(kind) or "", table(["field", "type", "meaning"], rows))

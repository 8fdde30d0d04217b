"""The structure of artifact types, which enters the keys of the nodes that take or return them."""

from __future__ import annotations

from typing import Any, get_args, get_origin

from pydantic import BaseModel

from dextera_build import digest
from dextera_build.artifacts.arrays import Array


def schema_digest(annotation: Any) -> str:
    """Digest of a type's structure: names, field types and array forms, through all artifacts that it refers to."""
    return digest.of_value(_schema(annotation, ()))


def _schema(annotation: Any, seen: tuple[str, ...]) -> Any:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        if annotation.__name__ in seen:
            return annotation.__name__
        inner = (*seen, annotation.__name__)
        fields = {
            name: [_schema(info.annotation, inner), [m.describe() for m in info.metadata if isinstance(m, Array)]]
            for name, info in annotation.model_fields.items()
        }
        return [annotation.__name__, fields]
    if get_args(annotation):
        origin = getattr(get_origin(annotation), "__name__", str(get_origin(annotation)))
        return [origin, [_schema(part, seen) for part in get_args(annotation)]]
    if isinstance(annotation, Array):
        return annotation.describe()
    return getattr(annotation, "__name__", repr(annotation))

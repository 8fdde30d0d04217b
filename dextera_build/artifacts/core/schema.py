"""The structure of artifact types: their declared fields, and the digest of it that enters keys."""

from __future__ import annotations

from functools import cache
from typing import Annotated, Any, get_args, get_origin

from pydantic import BaseModel

from dextera_build import digest
from dextera_build.artifacts.core.arrays import Array
from dextera_build.artifacts.core.forms import forms
from dextera_build.artifacts.core.frames import Frames
from dextera_build.artifacts.core.identity import spelled


@cache
def array_specs(kind: type[BaseModel]) -> dict[str, Array]:
    """Field -> declared array form, for the array fields of `kind`."""
    return {name: form.array for name, form in forms(kind).items() if form.array is not None}


@cache
def schema_digest(annotation: Any) -> str:
    """Digest of a type's structure: names, field types, array forms and frames, including all nested artifacts."""
    return digest.of_value(_schema(annotation, ()))


def _schema(annotation: Any, seen: tuple[str, ...]) -> Any:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        if annotation.__name__ in seen:
            return annotation.__name__
        inner = (*seen, annotation.__name__)
        fields = {
            name: [
                _schema(info.annotation, inner),
                [m.describe() for m in info.metadata if isinstance(m, Array | Frames)],
            ]
            for name, info in annotation.model_fields.items()
        }
        own = spelled(annotation) if hasattr(annotation, "type_version") else annotation.__name__
        return [own, fields]
    if get_origin(annotation) is Annotated:
        kind, *metadata = get_args(annotation)
        # The text of a validator would hold an address in memory, which differs from process to process.
        return [_schema(kind, seen), [m.describe() for m in metadata if isinstance(m, Array | Frames)]]
    if get_args(annotation):
        origin = getattr(get_origin(annotation), "__name__", str(get_origin(annotation)))
        return [origin, [_schema(part, seen) for part in get_args(annotation)]]
    return getattr(annotation, "__name__", repr(annotation))

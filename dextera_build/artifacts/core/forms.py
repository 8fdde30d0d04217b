"""Possible content of an artifact's field, by the kinds of values that its header distinguishes.

A union is decoded by these kinds: an artifact or a `Value` by the name of its type; an array, bytes, a dict and a
sequence by their tags. A declaration with two choices of one kind is ambiguous and is refused.
"""

from __future__ import annotations

import json
import types
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from functools import cache, reduce
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel

from dextera_build.artifacts.core.arrays import Array
from dextera_build.artifacts.core.content import Get
from dextera_build.artifacts.core.identity import identity, parse
from dextera_build.artifacts.core.value import Value
from dextera_build.errors import ArtifactError


@dataclass(frozen=True)
class Form:
    """The choices of a declared type; plain JSON values are always included, because pydantic checks those."""

    array: Array | None = None
    artifacts: Mapping[str, type[Any]] = field(default_factory=dict)
    """Identity -> type, for stored references."""
    values: Mapping[str, type[Value]] = field(default_factory=dict)
    """Type name -> type, for structures that are stored inline."""
    labelled: Form | None = None
    """Form of the values of a dict."""
    parts: tuple[Form, ...] = ()
    """Forms of the items of a sequence."""
    repeats: bool = False
    """Whether all items of a sequence have the form `parts[0]`."""

    @property
    def holds_arrays(self) -> bool:
        """Whether it can contain an array with a declared form, outside other artifacts."""
        inner = (*self.parts, *([self.labelled] if self.labelled else []))
        return self.array is not None or any(form.holds_arrays for form in inner)

    def part(self, index: int) -> Form:
        """The form of an item of a sequence."""
        return self.parts[0 if self.repeats else index] if self.parts else NOTHING

    def type_of(self, key: str, get: Get) -> type[Any]:
        """The type of the artifact whose header has digest `key`; of several, the header names one.

        Raises:
            ArtifactError: No such type may be here.
        """
        if len(self.artifacts) == 1:
            return next(iter(self.artifacts.values()))
        name, _ = parse(str(json.loads(get(key))["artifact"]))
        if name not in self.artifacts:
            raise unexpected(name, self.artifacts)
        return self.artifacts[name]


NOTHING = Form()


def unexpected(name: str, known: Iterable[str]) -> ArtifactError:
    """The error for a stored type that is not allowed in a field."""
    return ArtifactError(f"a stored {name} stands where {' or '.join(known) or 'none'} is declared", code="DXB-A108")


@cache
def forms(kind: type[BaseModel]) -> dict[str, Form]:
    """Field -> its possible content.

    Raises:
        ArtifactError: Stored values of a field could be read back in two ways.
    """
    made = {}
    for name, info in kind.model_fields.items():
        spec = _array_in(info.metadata)
        made[name] = Form(array=spec) if spec is not None else form_of(info.annotation, f"{kind.__name__}.{name}")
    return made


def form_of(hint: Any, name: str) -> Form:
    """Possible content of a declared type.

    Args:
        hint: The type.
        name: The field or input, for messages.

    Raises:
        ArtifactError: A stored value could be read back in two ways.
    """
    try:
        return _of(hint)
    except _AmbiguousError as error:
        raise ArtifactError(
            f"`{name}` cannot be read back: two of its types are stored as {error}",
            code="DXB-A114",
            hint="make it one type, or wrap each in an artifact of its own name",
        ) from None


def type_among(hint: Any, key: str, get: Get) -> type[Any]:
    """Of the artifact types that a declaration allows, the one whose header has digest `key`.

    Raises:
        ArtifactError: It allows no type of this name.
    """
    return _of(hint).type_of(key, get)


def _array_in(metadata: Iterable[object]) -> Array | None:
    """The array form among the metadata of an annotation."""
    return next((each for each in metadata if isinstance(each, Array)), None)


class _AmbiguousError(Exception):
    """Two choices have the same stored form."""


@cache
def _of(hint: Any) -> Form:
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        return reduce(_either, map(_of, inner))
    if origin is Annotated:
        spec = _array_in(inner[1:])
        return Form(array=spec) if spec is not None else _of(inner[0])
    if origin is dict:
        return Form(labelled=_of(inner[1]))
    if origin in (tuple, list):
        repeats = origin is list or inner[-1:] == (Ellipsis,)
        return Form(parts=tuple(map(_of, inner[:1] if repeats else inner)), repeats=repeats)
    if isinstance(hint, type) and issubclass(hint, Value):
        return Form(values={hint.__name__: hint})
    if isinstance(hint, type) and issubclass(hint, BaseModel):
        return Form(artifacts={identity(hint): hint})  # every other model is an artifact
    return NOTHING


def _either(one: Form, other: Form) -> Form:
    """Union of the choices of both."""
    both: dict[str, Any] = {}
    for slot in fields(Form):
        left, right = getattr(one, slot.name), getattr(other, slot.name)
        if isinstance(left, Mapping):
            if shared := left.keys() & right.keys():
                raise _AmbiguousError(f"`{min(shared)}`")
            both[slot.name] = {**left, **right}
            continue
        if left and right and slot.name != "repeats":
            raise _AmbiguousError({"array": "an array", "labelled": "a dict"}.get(slot.name, "a sequence"))
        both[slot.name] = left or right
    return Form(**both)

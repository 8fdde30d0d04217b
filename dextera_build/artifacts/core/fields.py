"""Writes the fields of artifacts into headers, and reads them back.

Plain JSON is stored as it is, and

    {"$array": [dtype, [shape], digest]}   an array; its blob is little-endian, C order
    {"$bytes": [digest, size]}             raw bytes
    {"$ref": digest}                       another artifact, by the digest of its header
    {"$map": {...}}                        a dict
    {"$value": {...}}                      a `Value`, stored inline
    {"$value": {"$type": name, ...}}       the same where the field may hold `Value`s of several types

An `Open` value is stored with all its fields, as plain data.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel

from dextera_build.artifacts.core.arrays import array_of, array_size, check_array, is_array, mapped_array, stored_array
from dextera_build.artifacts.core.content import SMALL, Get, Put
from dextera_build.artifacts.core.forms import NOTHING, Form, forms, unexpected
from dextera_build.artifacts.core.identity import identity
from dextera_build.artifacts.core.value import Open, Value
from dextera_build.errors import ArtifactError


def check(place: str, name: str, value: Any, form: Form, axes: dict[str, tuple[str, int]]) -> None:
    """Check every array in a field.

    Args:
        place: The field as shown in messages.
        name: The field.
        value: Its value.
        form: Form of the field.
        axes: See `check_array`.

    Raises:
        ArtifactError: An array does not have its declared form.
    """
    if is_array(value) and form.array is not None:
        check_array(place, name, value, form.array, axes)
    elif isinstance(value, Mapping) and form.labelled is not None:
        for label, item in value.items():
            check(f"{place}[{label}]", name, item, form.labelled, axes)
    elif isinstance(value, tuple | list):
        for index, item in enumerate(value):
            check(f"{place}[{index}]", name, item, form.part(index), axes)


def encode(value: Any, form: Form, put: Put) -> Any:
    """A value as JSON for a header; its bytes go through `put`.

    Raises:
        ArtifactError: Its type cannot be stored.
    """
    if is_array(value):
        return {"$array": [value.dtype.name, list(value.shape), stored_array(value, put)]}
    if isinstance(value, bytes):
        return {"$bytes": [put(value), len(value)]}
    if isinstance(value, Open) and (len(form.values) == 1 and isinstance(value, tuple(form.values.values()))):
        return {"$value": {name: encode(item, NOTHING, put) for name, item in value.model_dump().items()}}
    if isinstance(value, Value):
        _refuse_others(type(value).__name__, form.values)
        body = {name: encode(getattr(value, name), inner, put) for name, inner in forms(type(value)).items()}
        return {"$value": body if len(form.values) < 2 else {"$type": type(value).__name__, **body}}
    if isinstance(value, BaseModel):
        artifact: Any = value
        _refuse_others(identity(type(artifact)), form.artifacts)
        return {"$ref": artifact.encode(put)}
    if isinstance(value, Mapping):
        return {"$map": {str(name): encode(item, form.labelled or NOTHING, put) for name, item in value.items()}}
    if isinstance(value, tuple | list):
        return [encode(item, form.part(index), put) for index, item in enumerate(value)]
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise ArtifactError(f"a {type(value).__name__} cannot be stored in an artifact", code="DXB-A107")


def _refuse_others(name: str, known: Mapping[str, Any]) -> None:
    """Raise for a subclass of a declared type, which could be read back only as that type or not at all."""
    if known and name not in known:
        raise ArtifactError(f"a {name} cannot be stored where {' or '.join(known)} is declared", code="DXB-A107")


def decode(raw: Any, form: Form, get: Get) -> Any:
    """The value that `encode` wrote.

    Raises:
        ArtifactError: A stored type is not among the declared ones.
    """
    if isinstance(raw, list):
        return tuple(decode(item, form.part(index), get) for index, item in enumerate(raw))
    if not isinstance(raw, dict):
        return raw
    ((tag, body),) = raw.items()
    if tag == "$array":
        dtype, shape, blob = body
        if hasattr(get, "path") and array_size(dtype, shape) > SMALL:
            return mapped_array(dtype, shape, get.path(blob))
        return array_of(dtype, shape, get(blob))
    if tag == "$bytes":
        return get(body[0])
    if tag == "$ref":
        return form.type_of(body, get).decode(body, get)
    if tag == "$map":
        return {name: decode(item, form.labelled or NOTHING, get) for name, item in body.items()}
    name = body.get("$type", next(iter(form.values), "Value"))
    declared = list(form.values.values())
    if len(declared) == 1 and issubclass(declared[0], Open):
        return declared[0](**{each: _plain(body[each]) for each in body if each != "$type"})
    if name not in form.values:
        raise unexpected(name, form.values)
    kind = form.values[name]
    inner = forms(kind)
    return kind(**{each: decode(body[each], inner.get(each, NOTHING), get) for each in body if each != "$type"})


def _plain(raw: Any) -> Any:
    """A stored value as plain data, whatever its type was."""
    if isinstance(raw, list):
        return tuple(map(_plain, raw))
    if not isinstance(raw, dict):
        return raw
    ((_, body),) = raw.items()
    return {name: _plain(item) for name, item in body.items()}


def decode_item(raw: Any, form: Form, get: Get) -> Any:
    """A value of a dict that is decoded at its use, long after the header of the dict.

    Raises:
        ArtifactError: Its header is malformed, or its type is not among the declared ones.
    """
    try:
        return decode(raw, form, get)
    except (ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError) as error:
        why = f"{type(error).__name__}: {error}"
        raise ArtifactError("the stored header of an item is malformed", code="DXB-A111", facts={"why": why}) from None

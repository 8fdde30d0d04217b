"""Messages of ROS 2 as plain data, which JSON holds, and back: the forms of rosbridge.

Bytes are base64, as `rosbridge_library.internal.message_conversion` writes them, and numbers that are not finite are
null, because JSON has none; what comes back is not a number.
"""

from __future__ import annotations

import base64
import struct
from typing import Any

import numpy as np

from dextera_build.formats.ros import hashes
from dextera_build.formats.ros.types import full_name

_BYTES = ("uint8", "octet", "char", "byte")
_FLOATS = ("float32", "float64")


def plain(kind: str, message: bytes) -> dict[str, Any]:
    """The fields of a message.

    Args:
        kind: `sensor_msgs/JointState`.
        message: CDR with its encapsulation.

    Raises:
        ValueError: The bytes are no such message.
    """
    return _fields(full_name(kind), hashes.read(kind, message))


def message(kind: str, fields: Any) -> bytes:
    """The message (CDR with its encapsulation) of fields; those that are missing are empty or 0.

    Raises:
        ValueError: A field has another type than the message.
    """
    try:
        made = _made(full_name(kind), fields)
        return bytes(hashes.store().serialize_cdr(made, full_name(kind)))
    except (TypeError, ValueError, KeyError, AttributeError, OverflowError, struct.error) as error:
        raise ValueError(f"this is no {kind}: {error}") from None


def _fields(name: str, value: Any) -> dict[str, Any]:
    return {field: _plain(form, getattr(value, field)) for field, form in _forms(name)}


def _plain(form: Any, value: Any) -> Any:
    what, inner = form
    if what.name == "NAME":
        return _fields(inner, value)
    if what.name == "BASE":
        return _number(value)
    (element, _), base = inner, inner[0][1][0]
    if element[0].name == "BASE":
        if base in _BYTES:
            return base64.b64encode(bytes(value)).decode("ascii")
        if base in _FLOATS and not np.isfinite(value).all():
            return [_number(each) for each in value]
        return value.tolist() if isinstance(value, np.ndarray) else list(value)
    return [_plain(element, each) for each in value]


def _number(value: Any) -> Any:
    """A number or text as JSON has it."""
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value


def _made(name: str, fields: Any) -> Any:
    if not isinstance(fields, dict):
        raise TypeError(f"a {name} is an object of fields")
    known = dict(_forms(name))
    if unknown := sorted(fields.keys() - known.keys()):
        raise KeyError(f"{name} has no field {unknown[0]}")
    return hashes.store().types[name](**{field: _value(form, fields.get(field)) for field, form in known.items()})


def _value(form: Any, given: Any) -> Any:
    """The value of a field; `given` is None if it is missing, or not a finite number."""
    what, inner = form
    if what.name == "NAME":
        return _made(inner, {} if given is None else given)
    if what.name == "BASE":
        return _scalar(inner[0], given)
    (element, count) = inner
    if element[0].name != "BASE":
        return [_value(element, each) for each in given or [{}] * count]
    base = element[1][0]
    if base == "string":
        return [str(each) for each in given or [""] * count]
    if base in _BYTES and isinstance(given, str):
        return np.frombuffer(base64.b64decode(given, validate=True), np.uint8)
    values = [0] * count if given is None else given
    numbers = [np.nan if each is None and base in _FLOATS else each for each in values]
    made = np.array(numbers, np.dtype("uint8" if base in _BYTES else base))
    if count and len(made) != count:
        raise ValueError(f"{len(made)} numbers in place of {count}")
    return made


def _scalar(base: str, given: Any) -> Any:
    if base == "string":
        return "" if given is None else str(given)
    if base == "bool":
        return bool(given)
    if base in _FLOATS:
        return float("nan") if given is None else float(given)
    return 0 if given is None else int(given)


def _forms(name: str) -> list[tuple[str, Any]]:
    """Fields of a type with their forms, as rosbags has them."""
    return list(hashes.store().fielddefs[name][1])

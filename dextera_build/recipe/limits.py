"""Largest values of numeric options that declare no upper bound of their own, by the unit in their name.

They refuse slips of the unit, such as millimetres for metres. Planning applies them, so they are in no rule's code and
in no key, and no option can be without one.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from itertools import takewhile
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from dextera_build.artifacts.core.field_docs import bounds

_MOST = {"m": 100.0, "m2": 1e4, "m3": 1e6, "mm": 1e5, "s": 86_400.0, "seconds": 86_400.0, "kg": 1000.0, "n": 1e4}
_MOST |= {"nm": 1e4, "n_m": 1e6, "m_s": 10.0, "rad_s": 1e4, "deg_s": 6000.0, "hz": 1e5, "mb": 1e5, "px": 16_384.0}
_MOST |= {"rad": 4 * math.pi, "deg": 720.0, "seed": 2.0**32 - 1}
"""Unit -> largest value; a joint may turn twice."""
_UNITS = {*_MOST, "nms", "kgm2"}
"""Last words of a name that are units, alone or together: `damping_nms_rad`."""
_WHOLE = ("px", "rad", "deg", "seed")
"""Units whose largest value is the same for every option."""
_SLIP = 100.0
"""A quantity with another unit is at most this many times its default: a slip is one of a thousand."""
_COUNT = 1e7
_PLAIN = 1000.0
"""A number without a unit is at most this many times its default, and may always be 1."""
_UNKNOWN = 1e6
"""Largest number without a unit whose default is 0 or missing."""


def of_unit(name: str, field: FieldInfo) -> float | None:
    """`largest` if a unit gives it; a limit on counts, seeds and plain numbers is none that a user could come near."""
    unit = _unit(name)
    return largest(name, field) if unit in _MOST and unit != "seed" else None


def _unit(name: str) -> str:
    return "_".join([*takewhile(_UNITS.__contains__, reversed(name.split("_")))][::-1])


def largest(name: str, field: FieldInfo) -> float | None:
    """The largest absolute value of a numeric option; None if it declares an upper bound of its own."""
    if "<" in bounds(field):
        return None
    given = _numbers(field.get_default(), ())
    default = max((abs(number) for _, number in given if not isinstance(number, BaseModel)), default=0.0)
    unit = _unit(name)
    if unit in _MOST:
        return _MOST[unit] if unit in _WHOLE or not default else min(_MOST[unit], _SLIP * default)
    if re.search(r"\bint\b", str(field.annotation)):
        return _COUNT
    return max(1.0, _PLAIN * default) if default else _UNKNOWN


def exceeded(options: BaseModel) -> tuple[tuple[Any, ...], float, float] | None:
    """(path, value, largest value) of the first given option that is too large."""
    for name in options.model_fields_set:
        numbers = [*_numbers(getattr(options, name), (name,))]
        is_plain = any(not isinstance(value, BaseModel) for _, value in numbers)
        limit = largest(name, type(options).model_fields[name]) if is_plain else None
        for path, value in numbers:
            if isinstance(value, BaseModel):
                inner = exceeded(value)
                if inner is not None:
                    return (*path, *inner[0]), *inner[1:]
            elif limit is not None and abs(value) > limit:
                return path, value, limit
    return None


def _numbers(value: Any, path: tuple[Any, ...]) -> Iterator[tuple[tuple[Any, ...], Any]]:
    """Every number and group of options in a value, with its path."""
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from _numbers(inner, (*path, name))
    elif isinstance(value, list | tuple):
        for index, inner in enumerate(value):
            yield from _numbers(inner, (*path, index))
    elif isinstance(value, int | float | BaseModel) and not isinstance(value, bool):
        yield path, value

"""Access to fields of `capture.json`, with errors for invalid ones."""

from __future__ import annotations

import math
import reprlib
from typing import NoReturn

from dextera_build.rule import Context

from ..facts import NAME

LARGEST_BOARD_M = 2.0
"""Longest side of a square or marker [m]; larger numbers are probably millimetres."""


def wrong(ctx: Context, key: str, value: object, wanted: str, hint: str | None = None) -> NoReturn:
    """Raise for a field, such as `views[2].T_base_ee.t_m`."""
    ctx.fail(
        f"`{NAME}`: `{key}` is {'missing' if value is None else 'not valid'}",
        **({} if value is None else {"found": reprlib.repr(value)}),
        wanted=wanted,
        hint=hint or "`dxb new capture` writes a folder with every field",
    )


def number(value: object) -> float | None:
    """A finite number, or None."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value) if math.isfinite(value) else None


def numbers(value: object, count: int) -> list[float] | None:
    """A list of so many finite numbers, or None."""
    if not isinstance(value, list) or len(value) != count:
        return None
    found = [number(each) for each in value]
    return None if None in found else [each for each in found if each is not None]

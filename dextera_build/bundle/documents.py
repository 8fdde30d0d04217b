"""Untrusted JSON: bounded depth, no duplicate names, plain data only."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NoReturn

from dextera_build.bundle.errors import BundleRefused, ill_formed
from dextera_build.store.blobs import is_digest

DEEPEST = 64
"""Maximum nesting."""


def parse(data: bytes, what: str) -> dict[str, Any]:
    """Parse a JSON object.

    Raises:
        BundleRefused: It is not an object, or two parsers could read it differently.
    """
    try:
        found = json.loads(data, object_pairs_hook=_once, parse_constant=_no_constant)
    except RecursionError:
        raise ill_formed(what, "it is nested too deeply") from None
    except ValueError as error:
        raise ill_formed(what, f"it is not JSON ({error})") from None
    if not isinstance(found, dict):
        raise ill_formed(what, "it is not an object")
    if data.count(b"[") + data.count(b"{") > DEEPEST and _depth(found) > DEEPEST:
        raise ill_formed(what, "it is nested too deeply")
    return found


@dataclass(frozen=True)
class Form:
    """What a value must be."""

    name: str
    """As errors call it."""
    fits: Callable[[Any], bool]


TEXT = Form(
    "a text without control characters", lambda it: isinstance(it, str) and it.isprintable() and len(it) <= 4096
)
"""Can be shown on a terminal."""
BODY = Form("a text", lambda it: isinstance(it, str) and not any("\ud800" <= sign <= "\udfff" for sign in it))
"""A text of any length and with any characters, as UTF-8 holds them."""
DIGEST = Form("a SHA-256 digest", lambda it: isinstance(it, str) and is_digest(it))
COUNT = Form("a whole number", lambda it: type(it) is int and 0 <= it < 1 << 53)
SECONDS = Form("a number of seconds", lambda it: type(it) in (int, float) and 0 <= it < 1e15)
FLAG = Form("true or false", lambda it: isinstance(it, bool))


def maybe(form: Form) -> Form:
    """The same, or null."""
    return Form(f"{form.name}, or null", lambda it: it is None or form.fits(it))


def check(value: Any, form: Any, what: str, place: str = "it") -> Any:
    """`value`, if it has a form.

    Args:
        value: Parsed JSON.
        form: A `Form`; `[form]` for a list; `{name: form}` for an object with at least these fields; `{Form: form}` for
            an object with any names of one form.
        what: Names the document in errors.
        place: Names the value in errors.

    Raises:
        BundleRefused: It has not.
    """
    if isinstance(form, Form):
        if not form.fits(value):
            raise _unfit(what, place, form.name)
    elif isinstance(form, list):
        if not isinstance(value, list):
            raise _unfit(what, place, "a list")
        for item in value:
            check(item, form[0], what, place)
    elif not isinstance(value, dict):
        raise _unfit(what, place, "an object")
    else:
        for name, inner in form.items():
            if isinstance(name, str):
                check(value.get(name), inner, what, name)
                continue
            for key, item in value.items():
                check(key, name, what, f"a name in {place}")
                check(item, inner, what, key)
    return value


def _unfit(what: str, place: str, form: str) -> BundleRefused:
    return ill_formed(what, f"`{place[:80]}` is not {form}" if place != "it" else f"it is not {form}")


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        raise ValueError("a name stands twice")
    return found


def _no_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is no number")


def _depth(value: object) -> int:
    deepest, stack = 0, [(value, 1)]
    while stack:
        here, level = stack.pop()
        deepest = max(deepest, level)
        inside = here.values() if isinstance(here, dict) else here if isinstance(here, list) else ()
        stack += [(inner, level + 1) for inner in inside if isinstance(inner, dict | list)]
    return deepest


Read = Callable[[str], bytes]
"""digest -> bytes, checked."""

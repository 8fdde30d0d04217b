"""Parses untrusted JSON and checks its form."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from dextera_build import digest as digests
from dextera_build.bundle.errors import BundleRefused, ill_formed
from dextera_build.store.blobs import is_digest

Read = Callable[[str], bytes]
"""digest -> bytes, checked."""


@dataclass(frozen=True)
class Form:
    """A condition on a value."""

    name: str
    """Its name in errors."""
    fits: Callable[[Any], bool]


TEXT = Form(
    "a text without control characters", lambda it: isinstance(it, str) and it.isprintable() and len(it) <= 4096
)
"""Safe to show on a terminal."""
BODY = Form("a text", lambda it: isinstance(it, str) and not any("\ud800" <= sign <= "\udfff" for sign in it))
"""A text of any length, with any characters that UTF-8 can encode."""
DIGEST = Form("a SHA-256 digest", lambda it: isinstance(it, str) and is_digest(it))
COUNT = Form("a whole number", lambda it: type(it) is int and 0 <= it < 1 << 53)
SECONDS = Form("a number of seconds", lambda it: type(it) in (int, float) and 0 <= it < 1e15)
FLAG = Form("true or false", lambda it: isinstance(it, bool))


def maybe(form: Form) -> Form:
    """The same form, or null."""
    return Form(f"{form.name}, or null", lambda it: it is None or form.fits(it))


def parse(data: bytes, form: dict[Any, Any], what: str) -> dict[str, Any]:
    """Parse a JSON object.

    Args:
        data: JSON.
        form: See `check`.
        what: Names the document in errors.

    Raises:
        BundleRefused: It is not JSON, or does not have the form.
    """
    try:
        found = digests.plain(data)
    except ValueError as error:
        raise ill_formed(what, f"it is not JSON ({error})") from None
    check(found, form, what)
    return dict(found)


def refuse_other_spelling(data: bytes, value: object, what: str) -> None:
    """Refuse `data` unless it is the canonical JSON of `value`: another parser could read it differently.

    Raises:
        BundleRefused: `data` is not canonical.
    """
    try:
        same = digests.canonical(value) == data
    except ValueError:
        same = False
    if not same:
        raise ill_formed(what, "it is not spelled as dxb spells it")


def check(value: Any, form: Any, what: str, place: str = "it") -> None:
    """Check that a value has a form.

    Args:
        value: Parsed JSON.
        form: A `Form`; `[form]` for a list; `{name: form}` for an object with at least these fields; `{Form: form}` for
            an object with any names of one form.
        what: Names the document in errors.
        place: Names the value in errors.

    Raises:
        BundleRefused: It does not have the form.
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
            _check_field(value, name, inner, what, place)


def _check_field(value: dict[str, Any], name: str | Form, form: Any, what: str, place: str) -> None:
    if isinstance(name, Form):
        for key, item in value.items():
            check(key, name, what, f"a name in {place}")
            check(item, form, what, key)
    elif name not in value:
        raise _unfit(what, place, f"an object with `{name}`")
    else:
        check(value[name], form, what, name)


def _unfit(what: str, place: str, form: str) -> BundleRefused:
    return ill_formed(what, f"`{place[:80]}` is not {form}" if place != "it" else f"it is not {form}")

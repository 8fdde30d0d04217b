"""Untrusted JSON: bounded depth, no duplicate names, plain data only."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any, NoReturn

from dextera_build.bundle.errors import ill_formed
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


class Reader:
    """Reads fields of a parsed object, and names the one that is wrong.

    Args:
        raw: The object.
        what: Names it in errors.
    """

    def __init__(self, raw: object, what: str) -> None:
        if not isinstance(raw, dict):
            raise ill_formed(what, "it is not an object")
        self.raw: Mapping[str, Any] = raw
        self.what = what

    def text(self, name: str, default: str | None = None) -> str:
        """A text that can be shown on a terminal."""
        value = self.raw.get(name, default)
        if not isinstance(value, str) or not value.isprintable() or len(value) > 4096:
            self._refuse(name, "a text without control characters")
        return value

    def body(self, name: str) -> str:
        """A text of any length and with any characters, as UTF-8 holds them."""
        value = self.raw.get(name)
        if not isinstance(value, str) or any("\ud800" <= sign <= "\udfff" for sign in value):
            self._refuse(name, "a text")
        return value

    def maybe(self, name: str) -> str | None:
        """A text, or None."""
        return None if self.raw.get(name) is None else self.text(name)

    def digest(self, name: str) -> str:
        """A SHA-256 in hex."""
        value = self.raw.get(name)
        if not isinstance(value, str) or not is_digest(value):
            self._refuse(name, "a SHA-256 digest")
        return value

    def maybe_digest(self, name: str) -> str | None:
        """A SHA-256 in hex, or None."""
        return None if self.raw.get(name) is None else self.digest(name)

    def count(self, name: str) -> int:
        """A whole number, not below zero."""
        value = self.raw.get(name)
        if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < 1 << 53:
            self._refuse(name, "a whole number")
        return value

    def seconds(self, name: str) -> float:
        """A number, not below zero."""
        value = self.raw.get(name)
        if not isinstance(value, int | float) or isinstance(value, bool) or not 0 <= value < 1e15:
            self._refuse(name, "a number of seconds")
        return float(value)

    def items(self, name: str) -> list[Any]:
        """A list."""
        value = self.raw.get(name)
        if not isinstance(value, list):
            self._refuse(name, "a list")
        return value

    def texts(self, name: str) -> tuple[str, ...]:
        """A list of texts."""
        return tuple(Reader({"": value}, f"`{name}` of {self.what}").text("") for value in self.items(name))

    def table(self, name: str, *, needed: bool = True) -> dict[str, str]:
        """Text -> text."""
        value = self.raw.get(name, None if needed else {})
        if not isinstance(value, dict):
            self._refuse(name, "an object")
        return {_shown(key, self): Reader(value, f"`{name}` of {self.what}").text(key) for key in value}

    def _refuse(self, name: str, form: str) -> NoReturn:
        raise ill_formed(self.what, f"`{name}` is not {form}" if name else f"an item is not {form}")


def _shown(key: str, reader: Reader) -> str:
    return Reader({"": key}, reader.what).text("")


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

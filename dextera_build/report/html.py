"""A small HTML builder: text is escaped unless it is `Html` already, so names given by users cannot become markup."""

from __future__ import annotations

import html
from collections.abc import Iterable, Mapping
from typing import TypeAlias

_VOID = frozenset({"br", "col", "hr", "img", "input", "link", "meta"})


class Html(str):
    """Markup that is safe to insert unchanged."""

    __slots__ = ()


Child: TypeAlias = "str | int | Iterable[Child] | None"
"""Text, markup, nothing, or several of them."""

Attributes: TypeAlias = Mapping[str, str | int | float | bool | None]
"""Name -> value; None and False leave an attribute out, True writes only its name."""


def tag(name: str, attributes: Attributes | None = None, *children: Child) -> Html:
    """`<name attributes>children</name>`.

    Args:
        name: Element, a literal of the program.
        attributes: Values are escaped; names are literals of the program.
        children: Escaped unless they are `Html`.
    """
    written = "".join(_attribute(key, value) for key, value in (attributes or {}).items())
    if name in _VOID:
        return Html(f"<{name}{written}>")
    return Html(f"<{name}{written}>{join(children)}</{name}>")


def join(children: Iterable[Child]) -> Html:
    """Children one after another."""
    return Html("".join(_child(child) for child in children))


def _child(child: Child) -> str:
    if child is None:
        return ""
    if isinstance(child, Html):
        return child
    if isinstance(child, str | int):
        return html.escape(str(child))
    return join(child)


def _attribute(name: str, value: str | int | float | bool | None) -> str:
    if value is None or value is False:
        return ""
    if value is True:
        return f" {name}"
    if isinstance(value, float):
        value = f"{value:.1f}".removesuffix(".0")
    return f' {name}="{html.escape(str(value))}"'

"""The table of errors, from the places in the code that raise them."""

from __future__ import annotations

from dextera_build.explain import error_codes

from .markdown import code, escaped, join, table


def page() -> str:
    """One table per family of codes."""
    found: dict[str, dict[str, set[str]]] = {}
    for error in error_codes.sites():
        found.setdefault(error.code.split("-")[1][0], {}).setdefault(error.code, set()).add(error.message)
    return join(*(_family(letter, found[letter]) for letter in sorted(found)))


def _family(letter: str, found: dict[str, set[str]]) -> str:
    kind = error_codes.family(letter)
    rows = [[code(name), " / ".join(escaped(text) for text in sorted(texts))] for name, texts in sorted(found.items())]
    about = (kind.__doc__ or "").partition("\n")[0]
    return join(f"## {kind.__name__}", about, table(["code", "message"], rows))

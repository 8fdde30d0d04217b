"""What a recipe's file says, without comments, blank lines and layout."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import yaml

from dextera_build.recipe.strict_yaml import PARSER

_CHUNK = 1000
"""So many events are spelled together."""


def content(file: Path) -> str | None:
    """Digest of what a YAML file says, or None where it cannot be read or is not YAML."""
    state = hashlib.sha256()
    said: list[tuple[object, ...]] = []
    try:
        with file.open(encoding="utf-8") as text:  # which the parser reads piece by piece
            parser: Any = PARSER(text)
            event = parser.get_event()
            while type(event) is not yaml.StreamEndEvent:
                said.append(_plain(event))
                if len(said) == _CHUNK:
                    state.update(repr(said).encode(errors="surrogatepass"))
                    said.clear()
                event = parser.get_event()
    except (OSError, UnicodeDecodeError, yaml.YAMLError):
        return None
    state.update(repr(said).encode(errors="surrogatepass"))
    return state.hexdigest()


def _plain(event: Any) -> tuple[object, ...]:
    if type(event) is yaml.ScalarEvent:
        return event.value, event.tag, event.implicit[0], event.anchor
    return type(event).__name__, getattr(event, "tag", None), getattr(event, "anchor", None)

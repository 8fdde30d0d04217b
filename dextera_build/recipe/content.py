"""What a recipe's file says, without comments, blank lines and layout."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import yaml

from dextera_build.recipe.strict_yaml import PARSER


def content(file: Path) -> str | None:
    """Digest of what a YAML file says, or None where it cannot be read or is not YAML."""
    state = hashlib.sha256()
    try:
        parser: Any = PARSER(file.read_text(encoding="utf-8"))
        event = parser.get_event()
        while not isinstance(event, yaml.StreamEndEvent):
            state.update(_spelled(event))
            event = parser.get_event()
    except (OSError, UnicodeDecodeError, yaml.YAMLError):
        return None
    return state.hexdigest()


def _spelled(event: Any) -> bytes:
    name, anchor = type(event).__name__, getattr(event, "anchor", None)
    if isinstance(event, yaml.ScalarEvent):
        return repr((event.value, event.tag, event.implicit[0], anchor)).encode(errors="surrogatepass")
    return repr((name, getattr(event, "tag", None), anchor)).encode()

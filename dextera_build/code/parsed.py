"""Digested sources of earlier commands, so that a file whose bytes are known is not parsed again.

Parsing takes half of the time of a plan. A row of `state.db` holds the result of `syntax.source` for a file, with the
digest of the parsed bytes; a lost or foreign row costs one parse.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

from dextera_build import digest as digests
from dextera_build.code import names, order, syntax
from dextera_build.code.modules import digest_of
from dextera_build.store.state import State

_KIND = "source"


class Parsed:
    """Sources by file.

    Args:
        state: Keeps them between commands; written by `save`.
    """

    def __init__(self, state: State) -> None:
        self._state = state
        self._known: dict[str, bytes] | None = None
        self._fresh: dict[str, bytes] = {}

    def source(self, data: bytes, file: str) -> syntax.Source:
        """As `syntax.source`."""
        if self._known is None:
            self._known = self._state.all(_KIND)
        name = f"{digest_of(data)} {_form()}"
        found = _read(self._known.get(file, b""), name)
        if found is None:
            found = syntax.source(data, file)
            self._fresh[file] = json.dumps([name, vars(found)]).encode()
        return found

    def save(self) -> None:
        """Save what was parsed."""
        if self._fresh:
            self._state.put(_KIND, self._fresh)
            self._known = None
            self._fresh = {}


def _read(row: bytes, name: str) -> syntax.Source | None:
    try:
        known, parts = json.loads(row)
        return syntax.Source(**{part: _frozen(value) for part, value in parts.items()}) if known == name else None
    except (ValueError, TypeError, AttributeError):  # none, or malformed
        return None


def _frozen(value: Any) -> Any:
    """JSON arrays as tuples."""
    return tuple(map(_frozen, value)) if isinstance(value, list) else value


@cache
def _form() -> str:
    """Digest of the code that makes rows: another version of it makes others."""
    makers = (syntax, names, order, digests)
    return digests.of_bytes(b"".join(Path(module.__file__ or "").read_bytes() for module in makers))[:16]

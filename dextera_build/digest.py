"""SHA-256 digests and the canonical bytes that are digested."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

_CHUNK = 1 << 20


quoted: Callable[[str], str] = json.encoder.encode_basestring
"""A text as JSON has it."""
_spell_canonical = json.JSONEncoder(separators=(",", ":"), sort_keys=True, ensure_ascii=False, allow_nan=False).encode


def of_bytes(data: bytes) -> str:
    """Lower-case hex SHA-256 of `data`."""
    return hashlib.sha256(data).hexdigest()


def of_file(path: Path) -> str:
    """Lower-case hex SHA-256 of a file's bytes, read in chunks."""
    state = hashlib.sha256()
    with path.open("rb") as file:
        while chunk := file.read(_CHUNK):
            state.update(chunk)
    return state.hexdigest()


def canonical(value: object) -> bytes:
    """The one JSON spelling of plain data: sorted keys, no spaces, UTF-8.

    1, 1.0 and "1" have different bytes; NaN and infinities are refused.

    Raises:
        ValueError: `value` holds NaN or an infinity, or is nested deeper than can be written.
        TypeError: `value` holds something that is not plain data.
    """
    try:
        return _spell_canonical(value).encode()
    except RecursionError:
        raise ValueError("nested too deeply") from None


def plain(text: bytes | str) -> Any:
    """The plain data that a JSON text spells, which anybody may have written.

    Raises:
        ValueError: It is no JSON, or is nested deeper than can be read.
    """
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("nested too deeply") from None


def of_value(value: object) -> str:
    """Digest of the canonical bytes of plain data."""
    return of_bytes(canonical(value))

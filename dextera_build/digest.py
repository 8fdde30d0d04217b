"""SHA-256 digests and the canonical bytes that are digested."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

_CHUNK = 1 << 20


quoted: Callable[[str], str] = json.encoder.encode_basestring
"""Encodes a string as a JSON literal."""
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
    """Canonical JSON of plain data: sorted keys, no spaces, UTF-8.

    1, 1.0 and "1" have different bytes; NaN and infinities are refused.

    Raises:
        ValueError: `value` contains NaN or an infinity, or is nested too deeply.
        TypeError: `value` contains something other than plain data.
    """
    try:
        return _spell_canonical(value).encode()
    except RecursionError:
        raise ValueError("nested too deeply") from None


def plain(text: bytes | str) -> Any:
    """Parse untrusted JSON text to plain data.

    Raises:
        ValueError: The text is not JSON, or is nested too deeply.
    """
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("nested too deeply") from None


def of_value(value: object) -> str:
    """Digest of the canonical bytes of plain data."""
    return of_bytes(canonical(value))

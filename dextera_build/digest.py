"""SHA-256 digests and the canonical bytes that are digested."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from json import encoder as _json
from pathlib import Path
from typing import Any

_CHUNK = 1 << 20


def speller(
    *,
    separators: tuple[str, str] = (",", ":"),
    sort_keys: bool = False,
    ensure_ascii: bool = False,
    allow_nan: bool = True,
    default: Callable[[Any], object] | None = None,
) -> Callable[[object], str]:
    """What spells plain data as JSON in one line; `json.JSONEncoder` makes all that it needs anew for each text.

    Args:
        separators: Between items, and between a key and its value.
        sort_keys: Write mappings in the order of their keys.
        ensure_ascii: Write other characters as escapes: also half a character, which file names may hold.
        allow_nan: Write numbers that JSON does not have.
        default: Makes plain data of what is none; without, that is a `TypeError`.
    """
    maker: Any = getattr(_json, "c_make_encoder", None)  # only CPython has it
    plain = json.JSONEncoder(
        separators=separators, sort_keys=sort_keys, ensure_ascii=ensure_ascii, allow_nan=allow_nan, default=default
    )
    if maker is None:
        return plain.encode
    between, behind_key = separators
    # None: no note of what it is in the middle of, which an error would leave behind for the next text.
    text = _json.encode_basestring_ascii if ensure_ascii else quoted
    encode = maker(None, plain.default, text, None, behind_key, between, sort_keys, False, allow_nan)

    def spell(value: object) -> str:
        try:
            return "".join(encode(value, 0))
        except RecursionError:
            raise ValueError("nested too deeply") from None

    return spell


quoted: Callable[[str], str] = _json.encode_basestring
"""A text as JSON has it."""
_spell_canonical = speller(sort_keys=True, allow_nan=False)


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
        ValueError: `value` holds NaN or an infinity.
        TypeError: `value` holds something that is not plain data.
    """
    return _spell_canonical(value).encode()


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

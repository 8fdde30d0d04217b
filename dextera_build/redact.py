"""Removes secrets from text that is shown or written.

Addresses may hold passwords before their `@` and tokens in their query, so they pass through `redact` before they
become text in errors, events, displayed settings, and the command line of a run. Secrets that a process knows (those
that a rule asked for, those of `DXB_*` variables, the passwords of remotes) are removed from everything that it shows
or writes, also where a text quotes or encodes them.
"""

from __future__ import annotations

import re
from typing import Any

_HIDDEN = "***"
_USER = re.compile(
    r"(?:(?<=//)|(?<=\w:/)(?!/))(?:"  # an address that was parsed as a path has one slash
    r"[^\s/@:]*:(?!\d+/)(?:(?!\w+://)\S)*@"  # a password may contain an unencoded `/`
    r"|[^\s/]*@)"
)
_BARE_USER = re.compile(r"(?<![\w/])[^\s/:@,=`'\"]+:[^\s/@]+@")
"""User and password of an address without a scheme."""
_QUERY = re.compile(r"(://[^\s?`'\"]*\?)[^\s`'\"]*?(?=(?::(?:rw?|w|off))?(?:[\s`'\"]|$))")
"""Query of an address; keeps the mode that follows it in a list of remotes."""


SHORTEST = 8
"""Shorter values are not treated as secrets, because they occur by chance [characters]."""
_FIELD = re.compile(r"sig|token|key|secret|pass|auth|cred", re.IGNORECASE)
"""Fields of a query with such a name hold secrets."""
_values: dict[str, str] = {}
"""Spelling -> name of every secret that this process knows, longest first."""


def hide(name: str, value: str) -> None:
    """Remove a secret, in all its `spellings`, from everything that this process shows or writes from now on."""
    if len(value) < SHORTEST or value in _values:
        return
    known = {**_values, **dict.fromkeys(spellings(value), name)}
    _values.clear()
    _values.update(sorted(known.items(), key=lambda row: -len(row[0])))


def hide_address(text: str) -> None:
    """`hide` the password, or else the user, of every address in a text, and the secrets of its query."""
    from urllib.parse import unquote

    found = []
    for user in _USER.findall(text) + _BARE_USER.findall(text):
        user = user.removesuffix("@")
        found += [user.partition(":")[2] or user, user.rpartition(":")[2]]  # `oci:user:password@`
    for match in _QUERY.finditer(text):
        for row in match.group().removeprefix(match[1]).split("&"):
            name, equals, value = row.partition("=")
            found += [value or name] if _FIELD.search(name) or not equals else []
    for value in found:
        hide("password of an address", value)
        hide("password of an address", unquote(value))


def spellings(value: str) -> set[str]:
    """The spellings of a secret in texts: plain, quoted by Python, by JSON or in a URL, and in base64 at any offset."""
    import base64
    import json
    from urllib.parse import quote, quote_plus

    data = value.encode(errors="surrogateescape")
    # Whether Python escapes a quote depends on the other quotes of the text.
    quoted = [repr('"' + value)[2:-1], ascii('"' + value)[2:-1], repr(b'"' + data)[3:-1]]
    quoted += [text.replace("\\'", "'") for text in quoted]
    quoted += [json.dumps(value, ensure_ascii=is_ascii)[1:-1] for is_ascii in (True, False)]
    for offset, first in enumerate((0, 2, 3)):
        # Without the characters that depend on what precedes and follows the secret.
        text = base64.b64encode(bytes(offset) + data).decode()[first : (offset + len(data)) * 8 // 6]
        quoted += [text, text.replace("+", "-").replace("/", "_")]
    return {value, quote(data, safe=""), quote(data), quote_plus(data), *quoted}


def hidden() -> dict[str, str]:
    """Spelling -> name of the secrets that `hide` was given, longest first."""
    return dict(_values)


def redact_plain(data: Any) -> Any:
    """Plain data with the secrets that `hide` was given removed from its texts, names and bytes."""
    if not _values:
        return data
    if isinstance(data, str):
        for value in _values:
            data = data.replace(value, _HIDDEN)
    elif isinstance(data, bytes):
        for value in _values:
            data = data.replace(value.encode(errors="surrogateescape"), _HIDDEN.encode())
    elif isinstance(data, dict):
        return {redact_plain(name): redact_plain(value) for name, value in data.items()}
    elif isinstance(data, list | tuple):
        return [redact_plain(value) for value in data]
    return data


def redact(text: str) -> str:
    """The text without the user, password and query of every address, and without the secrets that `hide` was given."""
    text = str(redact_plain(text))
    if "@" in text:
        text = _BARE_USER.sub(f"{_HIDDEN}@", _USER.sub(f"{_HIDDEN}@", text))
    return _QUERY.sub(rf"\g<1>{_HIDDEN}", text) if "?" in text else text

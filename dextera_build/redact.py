"""Removes secrets from text that is shown or written.

Addresses may hold passwords before their `@` and tokens in their query, so they pass through `redact` before they
become text in errors, events, displayed settings, and the command line of a run. Secrets that a rule asked for are
removed from everything that its process shows or writes.
"""

from __future__ import annotations

import re
from typing import Any

_HIDDEN = "***"
_USER = re.compile(
    r"(?<=://)(?:"
    r"[^\s/@:]*:(?!\d+/)(?:(?!\w+://)\S)*@"  # a password may contain an unencoded `/`
    r"|[^\s/]*@)"
)
_BARE_USER = re.compile(r"(?<![\w/])[^\s/:@,=`'\"]+:[^\s/@]+@")
"""User and password of an address without a scheme."""
_QUERY = re.compile(r"(://[^\s?`'\"]*\?)[^\s`'\"]*?(?=(?::(?:rw?|w|off))?(?:[\s`'\"]|$))")
"""Query of an address; keeps the mode that follows it in a list of remotes."""


SHORTEST = 8
"""Shorter values are not treated as secrets, because they occur by chance [characters]."""
_values: dict[str, str] = {}
"""Value -> name of every secret that this process asked for."""


def hide(name: str, value: str) -> None:
    """Remove a secret from everything that this process shows or writes from now on."""
    if len(value) >= SHORTEST:
        _values[value] = name


def hidden() -> dict[str, str]:
    """Value -> name of the secrets that `hide` was told, longest first."""
    return dict(sorted(_values.items(), key=lambda row: -len(row[0])))


def redact_plain(data: Any) -> Any:
    """Plain data with the secrets that `hide` was told removed from its texts and bytes."""
    if not _values:
        return data
    if isinstance(data, str):
        for value in hidden():
            data = data.replace(value, _HIDDEN)
    elif isinstance(data, bytes):
        for value in hidden():
            data = data.replace(value.encode(), _HIDDEN.encode())
    elif isinstance(data, dict):
        return {name: redact_plain(value) for name, value in data.items()}
    elif isinstance(data, list | tuple):
        return [redact_plain(value) for value in data]
    return data


def redact(text: str) -> str:
    """The text without the user, password and query of every address, and without the secrets that `hide` was told."""
    text = str(redact_plain(text))
    if "@" in text:
        text = _BARE_USER.sub(f"{_HIDDEN}@", _USER.sub(f"{_HIDDEN}@", text))
    return _QUERY.sub(rf"\g<1>{_HIDDEN}", text) if "?" in text else text

"""Removes secrets from text that is shown or written.

Addresses may hold passwords before their `@` and tokens in their query, so they pass through `redact` before they
become text in errors, events, displayed settings, and the command line of a run.
"""

from __future__ import annotations

import re

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


def redact(text: str) -> str:
    """The text with the user, password and query of every address removed."""
    if "@" in text:
        text = _BARE_USER.sub(f"{_HIDDEN}@", _USER.sub(f"{_HIDDEN}@", text))
    return _QUERY.sub(rf"\g<1>{_HIDDEN}", text) if "?" in text else text

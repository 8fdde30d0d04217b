"""Takes secrets out of text that a person or a file will see.

Addresses carry passwords before their `@` and tokens in their query, so each address becomes text through `redact`:
errors, events, the settings as shown, and the command line of a run.
"""

from __future__ import annotations

import re

_HIDDEN = "***"
_USER = re.compile(
    r"(?<=://)(?:"
    r"[^\s/@:]*:(?!\d+/)(?:(?!\w+://)\S)*@"  # a password may hold `/`, which the address should have encoded
    r"|[^\s/]*@)"
)
_BARE_USER = re.compile(r"(?<![\w/])[^\s/:@,=`'\"]+:[^\s/@]+@")
"""User and password of an address whose scheme was forgotten."""
_QUERY = re.compile(r"(://[^\s?`'\"]*\?)[^\s`'\"]*?(?=(?::(?:rw?|w|off))?(?:[\s`'\"]|$))")
"""The mode that follows an address in a list of remotes stays."""


def redact(text: str) -> str:
    """A text in which no address has a user, a password or a query."""
    if "@" in text:
        text = _BARE_USER.sub(f"{_HIDDEN}@", _USER.sub(f"{_HIDDEN}@", text))
    return _QUERY.sub(rf"\g<1>{_HIDDEN}", text) if "?" in text else text

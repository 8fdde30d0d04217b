"""The request of a recorded call: its canonical form, its digest, and the check for secrets."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from dextera_build import digest as digests
from dextera_build.calls.secrets import secret_in
from dextera_build.errors import RuleError

SCHEMA = 1
"""Increased when the form of the document changes; every call is then sent again."""
CALL = "call"
"""The field that marks a key document of a call."""
_PICTURES = (b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff", b"II*\0", b"MM\0*", b"GIF8", b"BM", b"RIFF")
"""First bytes of pictures: PNG, JPEG, TIFF, GIF, BMP, WebP."""
PHOTOGRAPH = "photograph"
_DEEPEST = 64


@dataclass(frozen=True)
class Question:
    """One request to one service."""

    service: str
    document: bytes
    """Canonical JSON, which names attachments by digest and size."""
    octets: int
    """Size of the request with its attachments [bytes]."""
    model: str = ""
    """The model that the request names, for messages."""
    data: tuple[str, ...] = ()
    """Kinds of the user's data that it holds; see `consent`."""

    @property
    def key(self) -> str:
        """Digest of the document."""
        return digests.of_bytes(self.document)

    @property
    def shown(self) -> str:
        """Service and model, for messages."""
        return f"{self.service} {self.model}".rstrip()

    def facts(self) -> dict[str, object]:
        """The facts of errors about this request."""
        size = f"{self.octets:,} bytes"
        return {"service": self.service, "model": self.model or "-", "request": size, "call": self.key}


def question(service: str, request: object, secrets: Iterable[str] = (), data: Iterable[str] = ()) -> Question:
    """The question for a rule's request.

    Args:
        service: Names the service, never its host: the same question to another host has the same answer.
        request: Plain data; bytes in it are attachments.
        secrets: Texts that it must not contain, in addition to the values of variables such as `SERVICE_API_KEY`.
        data: Kinds of the user's data that it holds. A picture among its attachments counts as a `photograph`, named
            or not.

    Raises:
        RuleError: The request is not plain data, or holds a secret.
    """
    attached: list[bytes] = []
    plain = _plain(request, "request", attached, 0)
    document = digests.canonical({"schema": SCHEMA, CALL: 1, "service": service, "request": plain})
    for part in (document, *attached):
        if found := secret_in(part, secrets):
            raise RuleError(
                f"the request to `{service}` holds {found}, which would be kept in the store",
                code="DXB-B343",
                hint="give it to `send` alone; requests are recorded, what `send` adds is not",
            )
    model = request.get("model") if isinstance(request, Mapping) else None
    size = len(document) + sum(map(len, attached))
    pictured = b"data:image/" in document or any(part.startswith(_PICTURES) for part in attached)
    kinds = tuple(sorted({*data, *([PHOTOGRAPH] if pictured else [])}))
    return Question(service, document, size, model if isinstance(model, str) else "", kinds)


def _plain(value: object, place: str, attached: list[bytes], depth: int) -> Any:
    if depth > _DEEPEST:
        raise _not_plain(place, "is nested too deeply")
    if value is None or isinstance(value, str | bool | int):
        return value
    if isinstance(value, float):
        if not math.isfinite(value):
            raise _not_plain(place, f"is {value}")
        return value
    if isinstance(value, bytes):
        attached.append(value)
        return {"$bytes": [digests.of_bytes(value), len(value)]}
    if isinstance(value, list | tuple):
        return [_plain(item, f"{place}[{number}]", attached, depth + 1) for number, item in enumerate(value)]
    if isinstance(value, Mapping):
        for name in value:
            if not isinstance(name, str) or name.startswith("$"):
                raise _not_plain(f"{place}[{name!r}]", "is not named by a text without `$` in front")
        return {name: _plain(item, f"{place}.{name}", attached, depth + 1) for name, item in value.items()}
    raise _not_plain(place, f"is of type {type(value).__name__}")


def _not_plain(place: str, why: str) -> RuleError:
    return RuleError(
        f"`{place}` of a call {why}",
        code="DXB-B342",
        hint="a request is made of texts, finite numbers, booleans, None, lists, dicts and bytes",
    )

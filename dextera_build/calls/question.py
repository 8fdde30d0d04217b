"""The request of a recorded call: its canonical form, its digest, and the check for secrets."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from dextera_build import digest as digests
from dextera_build.errors import RuleError

SCHEMA = 1
"""Increased when the form of the document changes; every call is then sent again."""
CALL = "call"
"""The field that marks a key document of a call."""
_SECRET = re.compile(r"KEY|TOKEN|SECRET|PASSWORD|PASSWD|CREDENTIAL", re.IGNORECASE)
_SHORTEST = 8
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


def question(service: str, request: object, secrets: Iterable[str] = ()) -> Question:
    """The question for a rule's request.

    Args:
        service: Names the service, never its host: the same question to another host has the same answer.
        request: Plain data; bytes in it are attachments.
        secrets: Texts that it must not contain, besides the values of variables such as `SERVICE_API_KEY`.

    Raises:
        RuleError: The request is not plain data, or holds a secret.
    """
    attached: list[bytes] = []
    plain = _plain(request, "request", attached, 0)
    document = digests.canonical({"schema": SCHEMA, CALL: 1, "service": service, "request": plain})
    for data in (document, *attached):
        if found := secret_in(data, secrets):
            raise RuleError(
                f"the request to `{service}` holds {found}, which would be kept in the store",
                code="DXB-B343",
                hint="give it to `send` alone; requests are recorded, what `send` adds is not",
            )
    model = request.get("model") if isinstance(request, Mapping) else None
    size = len(document) + sum(map(len, attached))
    return Question(service, document, size, model if isinstance(model, str) else "")


def secret_in(data: bytes, secrets: Iterable[str] = ()) -> str | None:
    """A name for the secret that `data` contains, or None."""
    for name, value in _known(secrets):
        if value.encode() in data:
            return name
    return None


def without_secrets(text: str, secrets: Iterable[str] = ()) -> str:
    """`text` with every known secret replaced by `***`."""
    for _, value in _known(secrets):
        text = text.replace(value, "***")
    return text


def _known(secrets: Iterable[str]) -> Iterator[tuple[str, str]]:
    """(name, value) of everything that counts as a secret, longest first."""
    found = [(f"the value of `{name}`", value) for name, value in os.environ.items() if _SECRET.search(name)]
    found += [("a secret", value) for value in secrets]
    yield from sorted((row for row in found if len(row[1]) >= _SHORTEST), key=lambda row: -len(row[1]))


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

"""The report's sources in addition to events: results and artifact headers as plain JSON, without knowing any type."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, Protocol


class Blobs(Protocol):
    """Content-addressed bytes."""

    def get(self, digest: str, /) -> bytes:
        """Bytes of `digest`; raises if they are missing."""


class Result(Protocol):
    """The action cache's record of one node."""

    @property
    def line(self) -> str:
        """The rule's line about the result."""

    @property
    def previews(self) -> Sequence[tuple[str, str]]:
        """(caption, digest of PNG)."""

    @property
    def metrics(self) -> Mapping[str, tuple[float, str]]:
        """Name -> (value, unit)."""

    @property
    def seconds(self) -> float:
        """Duration of the node when it ran [s]."""

    @property
    def log(self) -> str | None:
        """Digest of the node's log."""

    @property
    def key_document(self) -> str:
        """Digest of the key document."""


class Actions(Protocol):
    """Key -> result."""

    def known(self, key: str, /) -> Result | None:
        """The result of `key`, with or without its bytes, or None."""


class Store(Protocol):
    """The part of a store that the report reads."""

    @property
    def blobs(self) -> Blobs:
        """Digest -> bytes."""

    @property
    def actions(self) -> Actions:
        """Key -> result."""


def result(store: Store, key: str | None) -> Result | None:
    """The stored result of `key`, or None; a damaged entry does not fail the report."""
    if key is None:
        return None
    try:
        return store.actions.known(key)
    except Exception:
        return None


def again(store: Store, key: str | None) -> tuple[str, ...]:
    """Digests of other outputs that reruns of `key` gave."""
    known = getattr(store, "divergent", None)
    found = known.get(key) if known is not None and key is not None else None
    return found.again if found is not None else ()


def blob(store: Store, digest: str | None) -> bytes | None:
    """Bytes, or None if the store no longer has them."""
    if not digest:
        return None
    try:
        return store.blobs.get(digest)
    except Exception:
        return None


def header(store: Store, digest: str | None) -> tuple[str, dict[str, Any]]:
    """Type, without its version, and fields of an artifact; ("", {}) if they cannot be read."""
    raw = blob(store, digest)
    try:
        data = json.loads(raw or b"null")
    except ValueError:
        return "", {}
    if not isinstance(data, dict) or not isinstance(data.get("fields"), dict):
        return "", {}
    return str(data.get("artifact", "")).partition("@")[0], data["fields"]


def plain(value: Any) -> Any:
    """A header's field with `$value` and `$map` unwrapped; references stay as they are."""
    if isinstance(value, list):
        return [plain(item) for item in value]
    if isinstance(value, dict):
        inner = value.get("$value", value.get("$map", value))
        return {name: plain(item) for name, item in inner.items()} if isinstance(inner, dict) else value
    return value


def text(store: Store, digest: str | None) -> str:
    """A blob as text; empty if it is missing."""
    return (blob(store, digest) or b"").decode(errors="replace")


def document(store: Store, found: Result | None) -> dict[str, Any]:
    """The key document of a result as plain data; {} if unknown."""
    try:
        data = json.loads(text(store, found.key_document if found else None) or "null")
    except ValueError:
        return {}
    return data if isinstance(data, dict) else {}

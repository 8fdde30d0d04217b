"""Reads entries that come from elsewhere: nothing in them is believed that can be checked."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from dextera_build.store import inside
from dextera_build.store.actions import ActionResult
from dextera_build.store.cas import is_digest
from dextera_build.store.reapi import OutputFile, decode
from dextera_build.store.remotes.remote import MOST_ENTRY, Digest

_MOST_BYTES = 1 << 48
_MOST_RESULT = 16 << 20
_FIELDS = {"output", "line", "previews", "metrics", "seconds", "log", "key_document"}


@dataclass(frozen=True)
class Entry:
    """An `ActionResult` message whose form is right."""

    document: Digest
    """Names the `result.json`."""
    inline: bytes
    """Its bytes where the message holds them, else b""."""
    blobs: tuple[Digest, ...]
    """All that is named beside it, each once."""
    asked: bytes
    """The key document where the message holds it, else b""."""
    roles: Mapping[str, str]
    """Path within the entry -> digest."""


def read(message: bytes, key: Digest) -> Entry | None:
    """The entry of `key` that a message holds, or None where it is not one that dxb wrote for this key."""
    if len(message) > MOST_ENTRY:
        return None
    try:
        files = decode(message)
    except (ValueError, IndexError, KeyError):
        return None
    roles = {file.path: file.digest for file in files}
    last, named = files[-1], files[:-1]
    right = (
        len(roles) == len(files)
        and last.path == inside.RESULT
        and last.size <= _MOST_RESULT
        and all(0 <= file.size < _MOST_BYTES and _has_role(file) for file in named)
        and "output" in roles
        and any(file.path == inside.KEY and (file.digest, file.size) == key for file in named)
    )
    if not right:
        return None
    blobs = tuple(dict.fromkeys(Digest(file.digest, file.size) for file in named))
    return Entry(Digest(last.digest, last.size), last.contents, blobs, inside.key_document(files), roles)


def result(entry: Entry, document: bytes) -> ActionResult | None:
    """The result that `document`, the entry's `result.json`, describes, or None where it is not one of this entry."""
    try:
        raw = json.loads(document)
    except (ValueError, RecursionError):
        return None
    if not isinstance(raw, dict) or raw.keys() - {"calls"} != _FIELDS or not _is_typed(raw):
        return None
    roles = {f"previews/{place}.png": blob for place, (_, blob) in enumerate(raw["previews"])}
    roles |= {"output": raw["output"], inside.KEY: raw["key_document"], inside.RESULT: entry.document.hash}
    roles |= {"log": raw["log"]} if raw["log"] is not None else {}
    roles |= {f"calls/{call}": call for call, _ in raw.get("calls", ())}
    if roles != {path: blob for path, blob in entry.roles.items() if not path.startswith(("closure/", "answers/"))}:
        return None
    return ActionResult.from_document(document)


def is_record(document: bytes) -> bool:
    """Whether this is the `result.json` of a recorded call."""
    try:
        raw = json.loads(document)
    except (ValueError, RecursionError):
        return False
    return isinstance(raw, dict) and raw.keys() == _FIELDS and _is_typed(raw) and not raw["previews"] and not raw["log"]


def _has_role(file: OutputFile) -> bool:
    kind, _, name = file.path.partition("/")
    if kind in ("closure", "calls", "answers"):
        return name == file.digest
    if kind == "previews":
        return name.removesuffix(".png").isdecimal()
    return file.path in ("output", "log", inside.KEY)


def _is_typed(raw: Mapping[str, Any]) -> bool:
    previews, metrics = raw["previews"], raw["metrics"]
    return (
        _is_blob(raw["output"])
        and _is_blob(raw["key_document"])
        and (raw["log"] is None or _is_blob(raw["log"]))
        and isinstance(raw["line"], str)
        and _is_number(raw["seconds"])
        and isinstance(previews, list)
        and all(_is_pair(pair) and isinstance(pair[0], str) and _is_blob(pair[1]) for pair in previews)
        and isinstance(raw.get("calls", []), list)
        and all(_is_pair(pair) and all(map(_is_blob, pair)) for pair in raw.get("calls", []))
        and isinstance(metrics, dict)
        and all(_is_pair(pair) and _is_number(pair[0]) and isinstance(pair[1], str) for pair in metrics.values())
    )


def _is_pair(value: object) -> bool:
    return isinstance(value, list) and len(value) == 2


def _is_blob(value: object) -> bool:
    return isinstance(value, str) and is_digest(value)


def _is_number(value: object) -> bool:
    # Of a whole number beyond all floats `math.isfinite` knows no answer.
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max

"""From what a rule returned to a result in the store: what a worker does itself, so that the scheduler need not."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from dextera_build.errors import RuleError
from dextera_build.store.entry import ActionResult
from dextera_build.store.store import Store


def publish(
    store: Store,
    key: str,
    reply: Mapping[str, Any],
    seconds: float,
    log: bytes,
    document: bytes,
    *,
    held: bool = False,
) -> dict[str, Any] | None:
    """Store the result of `key`, its entry last; None where the key has one already, which only the scheduler judges.

    Args:
        store: Takes it.
        key: Digest of the key document.
        reply: What the runner returned.
        seconds: How long that took [s].
        log: What was printed.
        document: The key document.
        held: Store all but the entry, and return that.

    Returns:
        Plain data: the digests `result`, `log` and `key_document`, `needs`: (digest, size) of its blobs, and the
        `entry`, one character for a byte, where it is not stored.

    Raises:
        DxbError: The result cannot be stored.
    """
    # Entries of recorded calls come before that of the result, and are the scheduler's then.
    if (held and reply.get("calls")) or (store.actions.has(key) and store.actions.outline(key) is not None):
        return None
    result, sizes = result_from(store, reply, seconds, log, key)
    more: dict[str, Any] = {}
    if held:
        entry = store.actions.made(result, sizes=sizes, document=document)
        needs = entry.files
        more["entry"] = entry.spell().decode("latin-1")
    else:
        needs = store.actions.write(key, result, sizes=sizes, document=document)
    return more | {
        "result": result.digest,
        "log": result.log,
        "key_document": result.key_document,
        "needs": [(file.digest, file.size) for file in needs],
    }


def result_from(
    store: Store, reply: Mapping[str, Any], seconds: float, log: bytes, document: str
) -> tuple[ActionResult, dict[str, int]]:
    """What a reply comes to, and the sizes of blobs that were stored for it; its log is stored.

    Args:
        store: Takes the log.
        reply: What the runner returned.
        seconds: How long that took [s].
        log: What was printed.
        document: Digest of the key document.

    Raises:
        DxbError: A metric is not finite, or the store cannot be written.
    """
    sizes: dict[str, int] = dict(reply.get("sizes") or {})
    kept = store.blobs.put(log) if log else None
    if kept is not None:
        sizes[kept] = len(log)
    return spelled(reply, seconds, kept, document), sizes


def spelled(reply: Mapping[str, Any], seconds: float, log: str | None, document: str) -> ActionResult:
    """What a reply comes to, with the digests of its log and of its key document.

    Raises:
        RuleError: A metric is not finite.
    """
    metrics = {}
    for name, (value, unit) in (reply.get("metrics") or {}).items():
        metrics[name] = (float(value), str(unit))
        if not math.isfinite(metrics[name][0]):
            raise RuleError(f"metric `{name}` is {value}, not a finite number", code="DXB-B305")
    return ActionResult(
        output=reply["output"],
        line=str(reply.get("line", "")),
        previews=tuple((str(caption), str(blob)) for caption, blob in reply.get("previews") or ()),
        metrics=metrics,
        seconds=round(seconds, 6),
        log=log,
        key_document=document,
        calls=tuple(dict.fromkeys((call["call"], call["result"]) for call in reply.get("calls") or ())),
    )

"""Turns an executor's report into a published result, or into the error of the node.

The process that runs a call stores only blobs. The scheduler writes the entry that makes them a result, here, after
checking them; a worker that dies at any moment leaves at most unreferenced blobs.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from dextera_build.engine.discovered import Reading
from dextera_build.engine.units import Node
from dextera_build.errors import DxbError, RuleError, StoreError
from dextera_build.store import traces
from dextera_build.store.entry import ActionResult
from dextera_build.store.store import Store
from dextera_build.workers.protocol import Ended


def publish(store: Store, node: Node, report: Ended, reading: Reading) -> ActionResult:
    """Publish the node's result, unless a file that it reads changed meanwhile; then drop its saved progress.

    If the key already has a result with another output, the divergence is recorded and the first result stays, unless
    its bytes are missing.

    Returns:
        The result of the key after publishing.

    Raises:
        DxbError: The node failed, read a file that changed, or its result cannot be stored.
    """
    if report.error is not None:
        node.log = log_of(store, report)
        raise report.error
    kept = node.key
    assert kept is not None
    assert report.reply is not None
    _check_leaves(store, node)
    if node.rule.discovers:
        reading.ran(node, report.reply)
    document = node.document or reading.document(node)
    result, first = _result(store, report, store.blobs.put(document)), _first(store, node, report.reply)
    if node.rule.discovers:
        traces.publish(store, result.key_document, first or result)
    elif first is None:
        store.actions.put(result.key_document, result)
    store.keep.drop(kept)
    return first or result


def log_of(store: Store, report: Ended) -> str | None:
    """Digest of the output of a failed run; None if it printed nothing or the disk has no room for it."""
    with suppress(StoreError):  # the node's own error matters more
        return store.blobs.put(report.log) if report.log else None
    return None


def _result(store: Store, report: Ended, key: str) -> ActionResult:
    """The result that a reply describes; stores its log.

    Raises:
        DxbError: A metric is not finite, or the store cannot be written.
    """
    reply: Mapping[str, Any] = report.reply or {}
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
        seconds=round(report.seconds, 6),
        log=store.blobs.put(report.log) if report.log else None,
        key_document=key,
        calls=tuple(dict.fromkeys((call["call"], call["result"]) for call in reply.get("calls") or ())),
    )


def _first(store: Store, node: Node, reply: Mapping[str, Any]) -> ActionResult | None:
    """The earlier result with another output that the node's key keeps, if any."""
    key = node.key or ""
    known = store.actions.known(key)
    if known is None or known.output == reply["output"]:
        return None
    if any(call["how"] == "replaced" for call in reply.get("calls") or ()):
        return None
    store.divergent.note(key, node.address, known.output, reply["output"], time.time())
    return store.actions.get(key)  # None: some of its bytes were lost


def _check_leaves(store: Store, node: Node) -> None:
    for leaf, digest in node.leaves:
        try:
            now = store.leaves.digest_leaf(leaf.path)
        except DxbError as error:
            now = error.message
        if now != digest:
            raise RuleError(
                f"`{leaf.path}` changed while `{node.address}` ran",
                code="DXB-B304",
                where=leaf.where,
                hint="build again; nothing was stored",
            )

"""From what an executor reports to a published result, or to the error that the node ends with."""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from dextera_build.engine.publish import result_from, spelled
from dextera_build.engine.reading import Reading
from dextera_build.engine.tasks import Ended
from dextera_build.engine.units import Node
from dextera_build.errors import DxbError, RuleError, StoreError
from dextera_build.store.entry import ActionResult, File
from dextera_build.store.store import Store
from dextera_build.store.traces import tree


def result_of(store: Store, node: Node, report: Ended, reading: Reading) -> ActionResult:
    """Publish what the node made, unless a file that it reads changed meanwhile; then drop what it kept for a next try.

    Where the key has a result with another output already, the divergence is noted, and the first one stays, unless it
    is bare: then its bytes are nowhere. What the worker has stored is taken over.

    Raises:
        DxbError: The node failed, read a file that changed, or its result cannot be stored.
    """
    if report.error is not None:
        node.log = log_of(store, report)
        raise report.error
    key = node.key
    assert report.reply is not None
    assert key is not None
    made = report.published
    if made is None or "entry" in made:
        _check_leaves(store, node)
    if made is None or not _is_entered(store, key, made):
        return _judged(store, node, report, reading)
    store.keep.drop(key)
    result = _spelled(report, made)
    result.know(made["result"])
    store.actions.rely(key, [File("", digest, size) for digest, size in made["needs"]])
    return result


def log_of(store: Store, report: Ended) -> str | None:
    """Digest of what a failed run printed, None where it printed nothing or its log has no room."""
    with suppress(StoreError):  # what the node failed of says more than that
        return store.blobs.put(report.log) if report.log else None
    return None


def _is_entered(store: Store, key: str, made: Mapping[str, Any]) -> bool:
    """Whether the key has the entry of what a worker made; where there is another one already, that is to be judged."""
    if "entry" in made:
        if store.actions.outline(key) is not None:
            return False
        store.actions.enter(key, made["entry"].encode("latin-1"))
    return True


def _judged(store: Store, node: Node, report: Ended, reading: Reading) -> ActionResult:
    """Publish what a node made whose key may have a result."""
    assert node.key is not None
    reply: Mapping[str, Any] = report.reply or {}
    kept = node.key
    sizes: dict[str, int] = {}
    if node.rule.discovers:
        reading.ran(node, reply)
    if report.published is not None:
        result = _spelled(report, report.published)
    else:
        result, sizes = result_from(store, reply, report.seconds, report.log, node.key)
    known = store.actions.outline(node.key)
    first = None
    replaced = any(call["how"] == "replaced" for call in reply.get("calls") or ())
    if known is not None and known[0] != result.output and not replaced:
        store.divergent.note(node.key, node.address, known[0], result.output, time.time())
        # It was forced: others build on the first output, which stays. Or bytes of the first were lost.
        first = store.actions.get(node.key)
    result = first or result
    if node.rule.discovers:
        # A blob: entries that lead to others name the key documents of these.
        store.blobs.put(reading.document(node))
        tree.publish(store, node.key, result)
    elif first is None:
        store.actions.put(node.key, result, sizes=sizes, document=reading.document(node))
    store.keep.drop(kept)
    return result


def _spelled(report: Ended, made: Mapping[str, Any]) -> ActionResult:
    return spelled(report.reply or {}, report.seconds, made["log"], made["key_document"])


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
                hint="build again; nothing of this run of the node was kept",
            )

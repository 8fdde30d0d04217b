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
from dextera_build.store.actions import ActionResult
from dextera_build.store.reapi import OutputFile
from dextera_build.store.store import Store
from dextera_build.store.traces import tree


def result_of(store: Store, node: Node, report: Ended, reading: Reading) -> ActionResult:
    """Publish what the node made, unless a file that it reads changed meanwhile; then drop what it kept for a next try.

    Where the key has a result with another output already, the divergence is noted, and the first one stays, unless it
    is bare: then its bytes are nowhere. What the worker has published is taken over.

    Raises:
        DxbError: The node failed, read a file that changed, or its result cannot be stored.
    """
    if report.error is not None:
        node.log = log_of(store, report)
        raise report.error
    assert report.reply is not None
    assert node.key is not None
    if report.published is not None:
        store.keep.drop(node.key)
        return _taken(store, node.key, report.reply, report.seconds, report.published)
    _check_leaves(store, node)
    kept = node.key
    if node.call.rule.discovers:
        reading.ran(node, report.reply)
    result, sizes = result_from(store, report.reply, report.seconds, report.log, reading.document(node))
    known = store.actions.outline(node.key)
    first = None
    replaced = any(call["how"] == "replaced" for call in report.reply.get("calls") or ())
    if known is not None and known[0] != result.output and not replaced:
        store.divergent.note(node.key, node.address, known[0], result.output, time.time())
        # It was forced: others build on the first output, which stays. Or bytes of the first were lost.
        first = store.actions.get(node.key)
    result = first or result
    if node.call.rule.discovers:
        tree.publish(store, node.key, result)
    elif first is None:
        store.actions.put(node.key, result, sizes=sizes)
    store.keep.drop(kept)
    return result


def log_of(store: Store, report: Ended) -> str | None:
    """Digest of what a failed run printed, None where it printed nothing or its log has no room."""
    with suppress(StoreError):  # what the node failed of says more than that
        return store.blobs.put(report.log) if report.log else None
    return None


def _taken(
    store: Store, key: str, reply: Mapping[str, Any], seconds: float, published: Mapping[str, Any]
) -> ActionResult:
    result = spelled(reply, seconds, published["log"], published["key_document"])
    result.know(published["result"])
    store.actions.rely(key, [OutputFile("", digest, size) for digest, size in published["needs"]])
    return result


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

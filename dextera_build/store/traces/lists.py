"""The results of a call with discovered inputs: a short list of traces under its static key.

The static key is the digest of the call's key document before anything was read. An ordinary result lies under it,
whose output is a `Reads`: the traces of the last runs, the newest first. A trace fits if each of its questions has the
same answer today; the static document and the trace give the key of the result. If two builders write the list at the
same time, a trace may be lost, and the call runs once more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

from dextera_build import digest as digests
from dextera_build.errors import DxbError
from dextera_build.store.entry import ActionResult
from dextera_build.store.references import UNREADABLE
from dextera_build.store.results import Found as Held
from dextera_build.store.store import Store
from dextera_build.store.traces import steps as traces
from dextera_build.store.traces.steps import Steps

MOST = 16
"""Traces of one call."""
_ARTIFACT = "Reads"

Static: TypeAlias = Mapping[str, Any]
Answer: TypeAlias = Callable[[str, str], str]
"""Kind, name -> the answer today; raises a `DxbError` if there is none."""


@dataclass(frozen=True)
class Found:
    """The result that today's answers lead to."""

    steps: Steps | None
    """None: no trace fits."""
    document: bytes
    """The key document with these steps."""
    held: Held | None


def find(store: Store, static: Static, answer: Answer) -> Found:
    """The result that today's answers lead to, if the store has it."""
    steps = fitting(store, static, answer)
    if steps is not None:
        document = traces.spelled(static, steps)
        held = store.actions.find(digests.of_bytes(document))
        if held is not None:
            return Found(steps, document, held)
    return Found(None, traces.spelled(static, None), None)


def fitting(store: Store, static: Static, answer: Answer) -> Steps | None:
    """The newest trace whose questions all have the same answers today, or None."""
    key = digests.of_value({**static, traces.READ: None})
    return next((steps for steps in known(store, key) if _fits(steps, answer)), None)


def known(store: Store, key: str) -> list[Steps]:
    """The traces that the store has under a static key."""
    found = store.actions.find(key)
    return listed(store, found.result) if found is not None else []


def listed(store: Store, result: ActionResult) -> list[Steps]:
    """The traces that a result lists, none if they are malformed."""
    try:
        stored = digests.plain(store.blobs.get(result.output))
        if stored["artifact"] != _ARTIFACT:
            return []
        return [traces.checked(steps) for steps in stored["fields"]["traces"]][:MOST]
    except UNREADABLE:
        return []


def merged(first: Iterable[Steps], others: Iterable[Steps]) -> list[Steps]:
    """Both lists without duplicates, cut to the number of traces that are kept."""
    found = list(dict.fromkeys([*first, *others]))[:MOST]
    while len(found) > 1 and sum(map(len, found)) > traces.MOST:
        found.pop()
    return found


def made(store: Store, static: Static, found: Iterable[Steps]) -> ActionResult:
    """The result that lists traces, with its blobs in the store and no entry."""
    content = [[list(step) for step in steps] for steps in found]
    output = store.blobs.put(digests.canonical({"artifact": _ARTIFACT, "fields": {"traces": content}}))
    key = store.blobs.put(traces.spelled(static, None))
    return ActionResult(output, f"{len(content)} traces", (), {}, 0.0, None, key)


def publish(store: Store, key: str, result: ActionResult, document: bytes = b"", *, may_lack: bool = False) -> bool:
    """Store a result; returns False if its entry is bare.

    The trace of a call with discovered inputs is added to the list under its static key.

    Args:
        store: Takes it.
        key: Digest of the key document.
        result: The result; a list of traces is merged with that of the store.
        document: The key document; b"": the store holds it already.
        may_lack: See `Actions.put`.

    Raises:
        MissingBlob: The result refers to something that is not in the store.
        StoreError: The disk is full, or the store cannot be written.
        ValueError: The result or its key document is not what it must be.
    """
    parts = traces.parts_of(document or store.blobs.get(key))
    if parts is None:
        return store.actions.put(key, result, document=document, may_lack=may_lack)
    static, steps = parts
    if steps is None:
        _keep(store, static, merged(known(store, key), listed(store, result)))
        return True
    # A collection that keeps the result keeps the list, too, and the names of the files that a pattern matched.
    root = store.blobs.put(traces.spelled(static, None))
    lists = (answer for kind, _, answer in steps if kind == "names" and store.blobs.has(answer))
    is_whole = store.actions.put(key, result, dict.fromkeys([root, *lists]), document=document, may_lack=may_lack)
    _keep(store, static, merged([steps], known(store, root)))
    return is_whole


def _keep(store: Store, static: Static, found: list[Steps]) -> None:
    result = made(store, static, found)
    store.actions.put(result.key_document, result)


def _fits(steps: Steps, answer: Answer) -> bool:
    try:
        return all(answer(kind, name) == told for kind, name, told in steps)
    except DxbError:
        return False

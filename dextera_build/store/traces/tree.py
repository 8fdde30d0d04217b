"""The results of one call that reads by itself, by what it read: a tree whose branches are answers.

Nothing holds the tree as a whole. Under the key of a beginning of a trace lie the steps that followed it (`Reads`);
where an answer is another now, the trace goes on under the key that ends with this answer. So two who ran the call
beside one another write different entries or equal ones, any store that holds results holds trees, and what is gone is
a miss.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from dextera_build import digest as digests
from dextera_build.errors import DxbError
from dextera_build.store.actions import Found as Held
from dextera_build.store.cas import MissingBlob
from dextera_build.store.entry import ActionResult
from dextera_build.store.store import Store
from dextera_build.store.traces import steps as traces
from dextera_build.store.traces.steps import Step, Steps

Static: TypeAlias = Mapping[str, Any]
Answer: TypeAlias = Callable[[str, str], str]
"""Kind, name -> what a call would be told now; raises a `DxbError` where there is no telling."""


@dataclass(frozen=True)
class Found:
    """How far the answers of today lead."""

    steps: Steps
    document: bytes
    """The key document with these steps."""
    held: Held | None
    """Its result; None: nobody knows what comes next."""


def key_of(document: bytes) -> str:
    """The key that a document stands for."""
    return digests.of_bytes(document)


def find(store: Store, static: Static, answer: Answer) -> Found:
    """Follow the answers of today through the tree of a call."""
    found = at(store, static, ())
    while found.held is not None:
        onward = going_on(store, found.held.result)
        if onward is None:
            return found
        asked = follow(found.steps, onward, answer)
        if asked is None:
            return Found(found.steps, found.document, None)
        found = at(store, static, asked)
    return found


def at(store: Store, static: Static, steps: Steps) -> Found:
    """What the store holds under one beginning of a trace."""
    document = traces.spelled(static, steps)
    return Found(steps, document, store.actions.find(key_of(document)))


def going_on(store: Store, result: ActionResult) -> Steps | None:
    """The steps that come next where `result` says so; None for a result of a call.

    A result that says what cannot be has the single step that nobody can answer.
    """
    try:
        return traces.steps_of(store.blobs.get(result.output))
    except (MissingBlob, ValueError, KeyError, TypeError, RecursionError):
        return (("", "", ""),)


def follow(before: Steps, onward: Steps, answer: Answer) -> Steps | None:
    """Ask on, up to the first answer that is another than it was; None where a question cannot be asked."""
    asked = list(before)
    for kind, name, known in onward:
        if not kind or len(asked) >= traces.MOST:
            return None
        try:
            now = answer(kind, name)
        except DxbError:
            return None
        asked.append((kind, name, now))
        if now != known:
            break
    return tuple(asked)


Get: TypeAlias = Callable[[bytes], Steps | None]
"""Key document -> the steps that some tree holds under it."""
Put: TypeAlias = Callable[[bytes, Steps], None]


def weave(static: Static, trace: Sequence[Step], get: Get, put: Put) -> list[bytes]:
    """Let a tree lead to the result of a trace, and return the key documents on the way there.

    Where the call asked something else after the same answers (it runs threads, or is not deterministic), what it asked
    last counts.
    """
    way: list[bytes] = []
    place = 0
    while place < len(trace):
        document = traces.spelled(static, trace[:place])
        way.append(document)
        known, rest = get(document), tuple(trace[place:])
        same = traces.first_difference(known or (), rest)
        if known is not None and same == len(known):
            place += same
        elif known is not None and same < len(rest) and known[same][:2] == rest[same][:2]:
            place += same + 1
        else:
            put(document, rest)
            break
    return way


def publish(store: Store, key: str, result: ActionResult, document: bytes = b"", *, bare: bool = False) -> None:
    """Store a result, `bare` where its bytes are absent; the tree of a call that reads by itself then leads to it.

    Args:
        store: Takes it.
        key: Digest of the key document.
        result: The result.
        document: The key document; b"": the store holds it already.
        bare: Whether bytes are absent.

    Raises:
        MissingBlob: The result refers to something that is not in the store.
        StoreError: The disk is full, or the store cannot be written.
        ValueError: The result or its key document is not what it must be.
    """
    put = store.actions.put_bare if bare else store.actions.put
    parts = traces.parts_of(document or store.blobs.get(key))
    if parts is None:
        put(key, result, document=document)
        return
    if document:
        store.blobs.put(document)
    static, steps = parts
    onward = traces.steps_of(store.blobs.get(result.output))
    way = weave(static, [*steps, *(onward or ())], lambda document: _known(store, document), _putting(store))
    if onward is None:
        # Whoever holds on to the result holds on to what leads there, and can say which files a pattern matched.
        lists = (answer for kind, _, answer in steps if kind == "names" and store.blobs.has(answer))
        beside = dict.fromkeys([*map(key_of, way), *lists])
        put(key, result, beside)


def loose(store: Store, document: bytes, steps: Steps) -> ActionResult:
    """A result that says how a trace goes on, with its blobs in the store and no entry."""
    output, key = store.blobs.put(traces.header_of(steps)), store.blobs.put(document)
    return ActionResult(output, f"reads on: {len(steps)}", (), {}, 0.0, None, key)


def _known(store: Store, document: bytes) -> Steps | None:
    found = store.actions.get(key_of(document))
    onward = going_on(store, found) if found is not None else None
    return onward if onward and onward[0][0] else None


def _putting(store: Store) -> Put:
    def put(document: bytes, steps: Steps) -> None:
        store.actions.put(key_of(document), loose(store, document, steps))

    return put

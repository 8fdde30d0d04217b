"""Discovered inputs: the questions that calls asked about the project's folder, and the results for their answers.

A trace is the list of steps of one run, in order. A step is (kind, name, answer):

    file    path      digest of the `File` there, or `-`
    there   path      `yes` or `no`
    names   pattern   digest of the list of files that match

The key document of a call with discovered inputs holds its trace under `read`. With null instead of a trace it is the
static document, which is known before the call runs; its digest is the static key. The output of the result under that
key is a `Reads`: the traces of the last runs, newest first. A trace matches if each of its questions still has the same
answer; the static document and the trace give the key of the result. If two builders write the list at the same time, a
trace may be lost, and the call runs once more.
"""

from __future__ import annotations

import json
import posixpath
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeAlias

from dextera_build import digest as digests
from dextera_build.errors import DxbError
from dextera_build.store.blobs import is_digest
from dextera_build.store.entry import ActionResult
from dextera_build.store.references import UNREADABLE
from dextera_build.store.store import Store

Step: TypeAlias = tuple[str, str, str]
Steps: TypeAlias = tuple[Step, ...]

READ = "read"
"""The field of a key document that holds the trace; absent for calls without discovered inputs."""
NONE, YES, NO = "-", "yes", "no"
_MOST_STEPS = 100_000
"""Most steps of one trace."""
_MOST = 16
"""Most traces of one call."""
_LONGEST = 4096
_ARTIFACT = "Reads"

Static: TypeAlias = Mapping[str, Any]
Answer: TypeAlias = Callable[[str, str], str]
"""Kind, name -> current answer; raises a `DxbError` if there is none."""

_ANSWERS: dict[str, Callable[[str], bool]] = {
    "file": lambda answer: answer == NONE or is_digest(answer),
    "there": lambda answer: answer in (YES, NO),
    "names": is_digest,
}


def spelled(static: Mapping[str, Any], steps: Sequence[Step] | None) -> bytes:
    """The key document with these steps; None: the static document."""
    return digests.canonical({**static, READ: None if steps is None else [list(step) for step in steps]})


def parts_of(document: bytes) -> tuple[dict[str, Any], Steps | None] | None:
    """A key document and its trace (None: it is static); None for a call without discovered inputs."""
    if b'"read":' not in document:
        return None
    found: dict[str, Any] = json.loads(document)
    if READ not in found:
        return None
    return found, None if found[READ] is None else checked(found[READ])


def label(kind: str, name: str) -> str:
    """A question in readable form."""
    return {"file": name, "there": f"exists {name}", "names": f"glob {name}"}[kind]


def is_plain(name: str) -> bool:
    """Whether `name` is a normalized relative path or pattern that stays below its folder."""
    return (
        0 < len(name) <= _LONGEST
        and "\0" not in name
        and not name.startswith("/")
        and name == posixpath.normpath(name)
        and name != "."
        and name.split("/", 1)[0] != ".."
    )


def checked(rows: Any) -> Steps:
    """Parse an untrusted trace.

    Raises:
        ValueError: It is not a valid trace.
    """
    if not isinstance(rows, list) or len(rows) > _MOST_STEPS:
        raise ValueError("a trace is a list of steps")
    found = tuple(tuple(row) for row in rows)
    for step in found:
        if len(step) != 3 or not all(isinstance(part, str) for part in step):
            raise ValueError("a step has a kind, a name and an answer")
        kind, name, answer = step
        if kind not in _ANSWERS or not is_plain(name) or not _ANSWERS[kind](answer):
            raise ValueError("a step is impossible")
    return found


def fitting(store: Store, static: Static, answer: Answer) -> Steps | None:
    """The newest trace whose questions all have the same answers now, or None."""
    key = digests.of_value({**static, READ: None})
    return next((steps for steps in known(store, key) if _fits(steps, answer)), None)


def known(store: Store, key: str) -> list[Steps]:
    """The traces that the store has under a static key."""
    found = store.actions.find(key)
    return listed(store, found.result) if found is not None else []


def listed(store: Store, result: ActionResult) -> list[Steps]:
    """The traces that a result lists; empty if they are malformed."""
    try:
        stored = digests.plain(store.blobs.get(result.output))
        if stored["artifact"] != _ARTIFACT:
            return []
        return [checked(steps) for steps in stored["fields"]["traces"]][:_MOST]
    except UNREADABLE:
        return []


def merged(first: Iterable[Steps], others: Iterable[Steps]) -> list[Steps]:
    """Both lists without duplicates, cut to the limits on traces and steps."""
    found = list(dict.fromkeys([*first, *others]))[:_MOST]
    while len(found) > 1 and sum(map(len, found)) > _MOST_STEPS:
        found.pop()
    return found


def made(store: Store, static: Static, found: Iterable[Steps]) -> ActionResult:
    """Make a result that lists traces; its blobs are stored, its entry is not."""
    content = [[list(step) for step in steps] for steps in found]
    output = store.blobs.put(digests.canonical({"artifact": _ARTIFACT, "fields": {"traces": content}}))
    key = store.blobs.put(spelled(static, None))
    return ActionResult(output, f"{len(content)} traces", (), {}, 0.0, None, key)


def publish(store: Store, key: str, result: ActionResult, *, may_lack: bool = False) -> bool:
    """Store a result; return False if its entry is bare.

    The trace of a call with discovered inputs is added to the list under its static key.

    Args:
        store: Where to store it.
        key: Digest of the key document, which is stored.
        result: The result; a list of traces is merged with the list in the store.
        may_lack: See `Actions.put`.

    Raises:
        MissingBlob: A blob that the result refers to is not in the store.
        StoreError: The disk is full, or the store cannot be written.
        ValueError: The result or its key document is malformed.
    """
    parts = parts_of(store.blobs.get(key))
    if parts is None:
        return store.actions.put(key, result, may_lack=may_lack)
    static, steps = parts
    if steps is None:
        _keep(store, static, merged(known(store, key), listed(store, result)))
        return True
    # A collection that keeps the result also keeps the list of traces, and the file names that patterns matched.
    root = store.blobs.put(spelled(static, None))
    lists = (answer for kind, _, answer in steps if kind == "names" and store.blobs.has(answer))
    is_whole = store.actions.put(key, result, [root, *lists], may_lack=may_lack)
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

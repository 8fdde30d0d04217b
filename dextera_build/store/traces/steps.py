"""A trace: the questions that a call asked about the project's folder while it ran, in order, with the answers.

A step is (kind, name, answer):

    file    path      digest of the `File` there, or `-`
    there   path      `yes` or `no`
    names   pattern   digest of the list of files that match

The key document of a call with discovered inputs holds its trace under `read`. With null instead of a trace it is the
static document, which is known before the call runs.
"""

from __future__ import annotations

import json
import posixpath
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

from dextera_build import digest as digests
from dextera_build.store.blobs import is_digest

Step: TypeAlias = tuple[str, str, str]
Steps: TypeAlias = tuple[Step, ...]

READ = "read"
"""The field of a key document that holds the trace; absent for calls without discovered inputs."""
NONE, YES, NO = "-", "yes", "no"
MOST = 100_000
"""Steps of one trace."""
_LONGEST = 4096


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
    """A question as people read it."""
    return {"file": name, "there": f"exists {name}", "names": f"glob {name}"}[kind]


def is_plain(name: str) -> bool:
    """Whether this is a path, or a pattern, below a folder, in its one spelling."""
    return (
        0 < len(name) <= _LONGEST
        and "\0" not in name
        and not name.startswith("/")
        and name == posixpath.normpath(name)
        and name != "."
        and name.split("/", 1)[0] != ".."
    )


def checked(rows: Any) -> Steps:
    """Parse a trace, which may come from anywhere.

    Raises:
        ValueError: No call can have made it.
    """
    if not isinstance(rows, list) or len(rows) > MOST:
        raise ValueError("a trace is a list of steps")
    found = tuple(tuple(row) for row in rows)
    for step in found:
        if len(step) != 3 or not all(isinstance(part, str) for part in step):
            raise ValueError("a step has a kind, a name and an answer")
        kind, name, answer = step
        if kind not in _ANSWERS or not is_plain(name) or not _ANSWERS[kind](answer):
            raise ValueError("a step says what cannot be")
    return found


_ANSWERS: dict[str, Callable[[str], bool]] = {
    "file": lambda answer: answer == NONE or is_digest(answer),
    "there": lambda answer: answer in (YES, NO),
    "names": is_digest,
}

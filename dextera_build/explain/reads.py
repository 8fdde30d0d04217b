"""The discovered reads of a node as text, for `why`, `show` and lineage."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from dextera_build.errors import DxbError
from dextera_build.report.wording import count
from dextera_build.store.blobs import MissingBlob
from dextera_build.store.questions import UNKNOWN, Look
from dextera_build.store.traces import NONE, READ, label

if TYPE_CHECKING:
    from dextera_build.session import Session


class Reads:
    """Describes the reads that calls made in the project's folder.

    Args:
        session: A session of the project.
    """

    def __init__(self, session: Session) -> None:
        self._store = session.store
        self._look = Look(session.project.root, session.store.leaves, session.store.root)

    def asked_now(self, document: Mapping[str, Any], old: Mapping[str, Any]) -> dict[str, Any]:
        """A key document with the reads of `old` as they would be answered now."""
        steps = [[kind, name, self._look.answer_or_unknown(kind, name)] for kind, name, _ in old.get(READ) or ()]
        return {**document, READ: steps}

    def change(self, named: str, document: Mapping[str, Any], old: object, new: object) -> tuple[str, dict[str, str]]:
        """How the answer to a read changed, and, for a pattern, each file that was added or removed."""
        step = next((step for step in (document.get(READ) or ()) if label(*step[:2]) == named), None)
        if step is None or new is None:
            return "not read now" if new is None else "not read before", {}
        if step[0] == "names":
            before, now = self.listing(str(old)), self._names(step[1])
            changed = {name: "added" for name in now if name not in (before or now)}
            changed |= {name: "removed" for name in before or () if name not in now}
            then = count(len(before), "file") if before is not None else "?"
            return f"{then} -> {count(len(now), 'file')}", changed
        words = {NONE: "gone", UNKNOWN: "not to be read"}
        told = [words.get(str(value), str(value)[:8]) for value in (old, new)]
        return " -> ".join(told), {}

    def rows(self, document: Mapping[str, Any]) -> dict[str, str]:
        """Read -> its answer in a document."""
        return {label(kind, name): self._told(kind, answer) for kind, name, answer in (document.get(READ) or ())}

    def listing(self, digest: str) -> list[str] | None:
        """Files that a pattern matched, or None if the store does not hold the list."""
        try:
            found: list[str] = json.loads(self._store.blobs.get(digest))
        except MissingBlob:
            return None
        return found

    def _told(self, kind: str, answer: str) -> str:
        if kind == "names":
            listed = self.listing(answer)
            return count(len(listed), "file") if listed is not None else f"list {answer[:12]}"
        if kind == "there":
            return answer
        try:
            return "sha256 " + str(json.loads(self._store.blobs.get(answer))["fields"]["data"]["$bytes"][0])
        except MissingBlob:
            return f"digest {answer[:12]}"

    def _names(self, pattern: str) -> list[str]:
        try:
            return self._look.names(pattern)
        except DxbError:
            return []

"""Origins of a node's inputs, from the log of the run that built it.

Garbage collection keeps the logs of the runs that built the results in a store.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from dextera_build.runs import log
from dextera_build.runs.history import Entry
from dextera_build.store.blobs import MissingBlob
from dextera_build.store.store import Store

Event = Mapping[str, Any]

_DEEP = 40


@dataclass(frozen=True)
class Origin:
    """The origin of one digest among the inputs of a node."""

    slot: str
    """`texts`, or `texts[mug]` for an item of a collection."""
    digest: str
    maker: Event | None = None
    """Final event of the node that returned it, or a value that contains it; None for files, and if unknown."""
    part: str = ""
    """Path in the output of that node: `.camera`, `.items[mug]`; "" for the whole."""
    path: str = ""
    """The project file or folder, if it was one."""


class Origins:
    """Answers from the logs of a store.

    Args:
        store: The store.
    """

    def __init__(self, store: Store) -> None:
        self._store = store
        self._runs: dict[str, dict[str, Event]] = {}
        self._headers: dict[str, dict[str, Any]] = {}

    def event(self, key: str, run: str = "") -> Event | None:
        """Final event of the node with this key in `run`, else in the newest run that has it; `run` names that run."""
        known = log.runs(self._store)
        for name in dict.fromkeys([*([run] if run in known else []), *reversed(known)]):
            for event in self._nodes(name).values():
                if event["key"] == key:
                    return event
        return None

    def made_for(self, event: Event) -> dict[str, Event]:
        """Address -> final event, for the nodes that a node depended on."""
        known = self._nodes(event["run"])
        return {node: known[node] for node in event["depends_on"] if node in known}

    def behind(self, entry: Entry) -> Iterator[Event]:
        """The final event of a node in the history, and those of all nodes that it depended on, nearest first."""
        start = self.event(entry.key, entry.run)
        waiting = deque([] if start is None else [start])
        seen = set()
        while waiting:
            event = waiting.popleft()
            if event["node"] not in seen:
                seen.add(event["node"])
                yield event
                waiting.extend(self.made_for(event).values())

    def of(self, event: Event) -> Iterator[Origin]:
        """The origins of all inputs of a node."""
        for slot, digest in event["inputs"].items():
            yield from self._of_slot(event, slot, digest)

    def contents(self, digest: str) -> dict[str, str]:
        """Name -> SHA-256 of the files in a `Folder`, or in a `File`, whose name is ""."""
        header = self._header(digest)
        fields = header.get("fields", {})
        if header.get("artifact") == "File":
            return {"": fields["data"]["$bytes"][0]}
        if header.get("artifact") == "Folder":
            return {name: value["$bytes"][0] for name, value in sorted(fields["files"]["$map"].items())}
        return {}

    def _of_slot(self, event: Event, slot: str, digest: str) -> Iterator[Origin]:
        if path := event["files"].get(slot):
            yield Origin(slot, digest, path=path)
        elif (made := self._maker(event, digest)) is not None:
            yield Origin(slot, digest, *made)
        elif self._header(digest).get("artifact") == "Collection":
            for label, item in self._header(digest)["fields"]["items"]["$map"].items():
                yield from self._of_slot(event, f"{slot}[{label}]", item["$ref"])
        else:
            yield Origin(slot, digest)

    def _maker(self, event: Event, digest: str) -> tuple[Event, str] | None:
        """The node whose output is or contains `digest`, and the path to it in that output."""
        read = self.made_for(event).values()
        whole = next((made for made in read if made["output"] == digest), None)
        if whole is not None:
            return whole, ""
        parts = [(made, way) for made in read if (way := self._way(made["output"], digest))]
        return min(parts, key=lambda found: len(found[1]), default=None)

    def _nodes(self, run: str) -> dict[str, Event]:
        """Address -> final event of each node that a run brought up to date."""
        if run not in self._runs:
            told = log.lines(self._store, run) if run else ()
            ended = [event for event in told if event["event"] == "node_finished"]
            self._runs[run] = {event["node"]: {**event, "run": run} for event in ended if event["output"]}
        return self._runs[run]

    def _header(self, digest: str) -> dict[str, Any]:
        if digest not in self._headers:
            self._headers[digest] = document(self._store, digest) or {}
        return self._headers[digest]

    def _way(self, output: str, digest: str) -> str:
        """The fields that lead from an output to one of its parts, `.items[mug].mesh`; "" if it is not one."""
        stack, seen = [(output, "")], {output}
        while stack:
            here, way = stack.pop(0)
            for step, ref in _refs(self._header(here).get("fields", {})):
                if ref == digest:
                    return way + step
                if ref not in seen:
                    seen.add(ref)
                    stack.append((ref, way + step))
        return ""


def document(store: Store, key: str) -> dict[str, Any] | None:
    """A key document (the key is its digest) or a header; None if the store lacks it."""
    try:
        loaded: dict[str, Any] = json.loads(store.blobs.get(key))
    except MissingBlob:
        return None
    return loaded


def margin(depth: int) -> str:
    """The indent of a line in a tree: two spaces per level, and beyond `_DEEP` levels the number of further levels.

    A chain of ten thousand nodes would otherwise be mostly spaces.
    """
    return "  " * min(depth, _DEEP) + (f"+{depth - _DEEP} " if depth > _DEEP else "")


def _refs(fields: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """(`.field` or `.field[label]`, digest) of every artifact that a header names directly."""
    for name, value in fields.items():
        items = value.get("$map", {"": value}) if isinstance(value, dict) else {}
        for label, item in items.items():
            if isinstance(item, dict) and "$ref" in item:
                yield f".{name}[{label}]" if label else f".{name}", item["$ref"]

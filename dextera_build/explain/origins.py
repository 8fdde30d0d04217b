"""Where the bytes that a node read came from: which other node made them, or which project file they are.

Key documents say what was read, by digest. Who made a digest is asked of the event log of a run that had the key, then
of the results in the store, whose names are then not known.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from dextera_build.runs import log
from dextera_build.session import Session
from dextera_build.store.blobs import MissingBlob

Event = dict[str, Any]

_DEEP = 40


@dataclass(frozen=True)
class Origin:
    """What one digest is."""

    digest: str
    key: str = ""
    """Key of the node that returned it, or returned what it is a part of."""
    node: str = ""
    """Address of that node, where it is known."""
    part: str = ""
    """Where in what that node returned: `.camera`, `.items[mug]`; "" for the whole."""
    path: str = ""
    """The project file or folder that it is; `?` where its place is not known."""
    files: Mapping[str, str] = field(default_factory=dict)
    """Name below `path` ("" for a file by itself) -> SHA-256 of its bytes."""
    items: Mapping[str, Origin] = field(default_factory=dict)
    """Label -> origin, for a collection that the engine gathered."""

    def nodes(self) -> Iterator[Origin]:
        """Those that nodes made, through collections."""
        if self.key:
            yield self
        for item in self.items.values():
            yield from item.nodes()


class Origins:
    """Answers for one recipe of one project.

    Args:
        session: The recipe.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._store = session.store
        self._runs: dict[str, dict[str, Event]] = {}
        self._headers: dict[str, Any] = {}

    def document(self, key: str) -> dict[str, Any] | None:
        """The key document of a key, or None where the store lacks it."""
        try:
            # A key is the digest of its document.
            loaded: dict[str, Any] = json.loads(self._store.blobs.get(key))
        except MissingBlob:
            return None
        return loaded

    def event(self, key: str, run: str = "") -> Event | None:
        """How a node with this key ended in `run`, or else in the newest run that knows it; `run` says which."""
        for name in dict.fromkeys([run, *reversed(self._known_runs)] if run else reversed(self._known_runs)):
            for event in self._nodes(name).values():
                if event["key"] == key:
                    return {**event, "run": name}
        return None

    def read_by(self, key: str, run: str = "") -> dict[str, str]:
        """Address -> key of the nodes that the node with `key` waited for; none where no run knows it."""
        event = self.event(key, run)
        if event is None:
            return {}
        known = self._nodes(event["run"])
        return {node: known[node]["key"] for node in event["depends_on"] if node in known}

    def of(self, key: str, slot: str, digest: str, run: str = "") -> Origin:
        """Where the input `slot` of the node with `key` came from.

        Args:
            key: The reader.
            slot: Its input; `trials[act]` for an item of a collection.
            digest: What the input was.
            run: A run that had the reader under this key.
        """
        event = self.event(key, run)
        candidates: dict[str, str] = {}
        told: dict[str, str] = {}
        path = ""
        if event is not None:
            candidates = {made: node for node, made in self.read_by(key, event["run"]).items()}
            told = {made: self._nodes(event["run"])[node]["output"] for made, node in candidates.items()}
            path = event.get("files", {}).get(slot, "")
        if path:
            return Origin(digest, path=path, files=self.contents(digest))
        return (
            self._made_by(digest, candidates)
            or self._told_by(digest, candidates, told)
            or self._whole(digest, key)
            or self._part(digest, key, named=True)
            or self._leaf(digest)
            or self._collection(key, slot, digest, run)
            or self._part(digest, key, named=False)
            or Origin(digest)
        )

    @cached_property
    def _known_runs(self) -> list[str]:
        return log.runs(self._store)

    def _nodes(self, run: str) -> dict[str, Event]:
        """Address -> the last word on each node that a run brought up to date."""
        if run not in self._runs:
            told = log.read(self._store, run) if run in self._known_runs else []
            ended = [event for event in told if event["event"] == "node_finished" and event["output"]]
            self._runs[run] = {event["node"]: event for event in ended}
        return self._runs[run]

    def _made_by(self, digest: str, candidates: Mapping[str, str]) -> Origin | None:
        """Among the nodes (key -> address) that the reader waited for: the whole output first, then a part of one."""
        outlines = {key: self._store.actions.outline(key) for key in candidates}
        for key, outline in outlines.items():
            if outline is not None and outline[0] == digest:
                return Origin(digest, key, candidates[key])
        for key, outline in outlines.items():
            if outline is not None and digest in outline[1]:
                return Origin(digest, key, candidates[key], part=self._way(outline[0], digest))
        return None

    def _told_by(self, digest: str, candidates: Mapping[str, str], told: Mapping[str, str]) -> Origin | None:
        """Among nodes whose results are not here: a bundle brings their names and the headers of what they returned."""
        for key, output in told.items():
            if output == digest:
                return Origin(digest, key, candidates[key])
            if part := self._way(output, digest):
                return Origin(digest, key, candidates[key], part=part)
        return None

    def _whole(self, digest: str, reader: str) -> Origin | None:
        for key in self._outputs.get(digest, ()):
            if self._may_feed(key, reader):
                return Origin(digest, key, self._addresses.get(key, ""))
        return None

    def _part(self, digest: str, reader: str, *, named: bool) -> Origin | None:
        """The result, of this recipe's nodes or of all, that holds it and the least beside it."""
        holders = [
            (len(refs), key, output)
            for key, (output, refs) in self._outlines.items()
            if digest in refs and (key in self._addresses) >= named and self._may_feed(key, reader)
        ]
        if not holders:
            return None
        _, key, output = min(holders)
        return Origin(digest, key, self._addresses.get(key, ""), part=self._way(output, digest))

    def _may_feed(self, key: str, reader: str) -> bool:
        """Whether a node can have been read by another: one that was built later cannot, and none reads itself."""
        return key != reader and self._times.get(key, 0.0) < self._times.get(reader, math.inf)

    def _collection(self, key: str, slot: str, digest: str, run: str) -> Origin | None:
        header = self._header(digest)
        if header.get("artifact") != "Collection":
            return None
        parts = {label: value["$ref"] for label, value in header["fields"]["items"]["$map"].items()}
        items = {label: self.of(key, f"{slot}[{label}]", part, run) for label, part in parts.items()}
        return Origin(digest, items=items)

    @cached_property
    def _times(self) -> dict[str, float]:
        return {entry.key: entry.time for entry in self._session.history.values()}

    @cached_property
    def _addresses(self) -> dict[str, str]:
        return {entry.key: node for node, entry in self._session.history.items()}

    @cached_property
    def _outlines(self) -> dict[str, tuple[str, frozenset[str]]]:
        """Every result in the store, those of this recipe's nodes first."""
        keys = dict.fromkeys([*self._addresses, *self._store.actions.keys()])
        found = ((key, self._store.actions.outline(key)) for key in keys)
        return {key: outline for key, outline in found if outline is not None}

    @cached_property
    def _outputs(self) -> dict[str, list[str]]:
        found: dict[str, list[str]] = {}
        for key, (output, _) in self._outlines.items():
            found.setdefault(output, []).append(key)
        return found

    def _leaf(self, digest: str) -> Origin | None:
        """A project file or folder by what the store remembers of their bytes."""
        contents = self.contents(digest)
        if not contents:
            return None
        name, blob = min(contents.items())
        for path in self._store.leaves.paths(blob):
            root = path.removesuffix(f"/{name}") if name else path
            if all(f"{root}/{inner}" in self._store.leaves.paths(known) for inner, known in contents.items() if inner):
                return Origin(digest, path=self._shown(root), files=contents)
        return None

    def contents(self, digest: str) -> dict[str, str]:
        """Name -> SHA-256 of the files in a `File` or `Folder`."""
        header = self._header(digest)
        fields = header.get("fields", {})
        if header.get("artifact") == "File":
            return {"": fields["data"]["$bytes"][0]}
        if header.get("artifact") == "Folder":
            return {name: value["$bytes"][0] for name, value in sorted(fields["files"]["$map"].items())}
        return {}

    def _header(self, digest: str) -> dict[str, Any]:
        if digest not in self._headers:
            try:
                self._headers[digest] = json.loads(self._store.blobs.get(digest))
            except MissingBlob:
                self._headers[digest] = {}
        header: dict[str, Any] = self._headers[digest]
        return header

    def _way(self, output: str, digest: str) -> str:
        """The fields that lead from an output to one of its parts: `.items[mug].mesh`."""
        stack, seen = [(output, "")], {output}
        while stack:
            here, way = stack.pop(0)
            if here == digest:
                return way
            for step, ref in _refs(self._header(here).get("fields", {})):
                if ref not in seen:
                    seen.add(ref)
                    stack.append((ref, way + step))
        return ""

    def _shown(self, path: str) -> str:
        return path.removeprefix(f"{self._session.project.root}/")


def margin(depth: int) -> str:
    """What stands before a line of a tree: two spaces a level, and beyond `_DEEP` levels the number of the rest.

    A chain of ten thousand nodes would be mostly spaces.
    """
    return "  " * min(depth, _DEEP) + (f"+{depth - _DEEP} " if depth > _DEEP else "")


def _refs(fields: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """(`.field` or `.field[label]`, digest) of every artifact that a header names directly."""
    for name, value in fields.items():
        if isinstance(value, dict) and "$ref" in value:
            yield f".{name}", value["$ref"]
        elif isinstance(value, dict) and "$map" in value:
            for label, item in value["$map"].items():
                if isinstance(item, dict) and "$ref" in item:
                    yield f".{name}[{label}]", item["$ref"]

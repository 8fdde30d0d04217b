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
from dextera_build.store.store import Store

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
        self._outlines: dict[str, tuple[str, frozenset[str]] | None] = {}

    def document(self, key: str) -> dict[str, Any] | None:
        """The key document of a key, or None where the store lacks it."""
        return document(self._store, key)

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
        read: dict[str, Event] = {}
        if event is not None:
            if path := event.get("files", {}).get(slot, ""):
                return Origin(digest, path=path, files=self.contents(digest))
            nodes = self._nodes(event["run"])
            read = {nodes[node]["key"]: nodes[node] for node in event["depends_on"] if node in nodes}
        own = {made: entry for made, entry in self._named.items() if self._may_feed(made, key)}
        return (
            self._holder(digest, {made: (told["node"], told["output"]) for made, told in read.items()})
            or self._holder(digest, {made: (node, "") for made, (node, _) in own.items()})
            or self._leaf(digest)
            or self._collection(key, slot, digest, run)
            or self._holder(
                digest, {made: ("", "") for made in sorted(self._store.actions.keys()) if self._may_feed(made, key)}
            )
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

    def _holder(self, digest: str, nodes: Mapping[str, tuple[str, str]]) -> Origin | None:
        """Among nodes (key -> address and output): the one that returned it, else the one with the least beside it.

        The store may lack their results: a bundle brings their names and the headers of what they returned.
        """
        found = []
        for key, (node, told) in nodes.items():
            output, refs = self._outline(key) or (told, None)
            if output == digest:
                return Origin(digest, key, node)
            if output and (digest in refs if refs is not None else self._way(output, digest)):
                found.append((len(refs or ()), key, node, output))
        if not found:
            return None
        _, key, node, output = min(found)
        return Origin(digest, key, node, part=self._way(output, digest))

    def _may_feed(self, key: str, reader: str) -> bool:
        """Whether a node can have been read by another: one that was built later cannot, and none reads itself."""
        made, read = (self._named.get(one, ("", default))[1] for one, default in ((key, 0.0), (reader, math.inf)))
        return key != reader and made < read

    def _collection(self, key: str, slot: str, digest: str, run: str) -> Origin | None:
        header = self._header(digest)
        if header.get("artifact") != "Collection":
            return None
        parts = {label: value["$ref"] for label, value in header["fields"]["items"]["$map"].items()}
        items = {label: self.of(key, f"{slot}[{label}]", part, run) for label, part in parts.items()}
        return Origin(digest, items=items)

    @cached_property
    def _named(self) -> dict[str, tuple[str, float]]:
        """Key -> address and time of the recipe's nodes, as they were built last."""
        return {entry.key: (node, entry.time) for node, entry in self._session.history.items()}

    def _outline(self, key: str) -> tuple[str, frozenset[str]] | None:
        if key not in self._outlines:
            entry = self._store.actions.entry(key)
            self._outlines[key] = (entry.result.output, entry.refers) if entry else None
        return self._outlines[key]

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
            self._headers[digest] = document(self._store, digest) or {}
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


def document(store: Store, key: str) -> dict[str, Any] | None:
    """The key document of a key, whose digest the key is, or a header; None where the store lacks it."""
    try:
        loaded: dict[str, Any] = json.loads(store.blobs.get(key))
    except MissingBlob:
        return None
    return loaded


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

"""What a build should do, said in the shortest way: recursion, one dict as the cache, no states."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dextera_build import digest
from dextera_build.engine.graph import (
    Address,
    Call,
    Fixed,
    Graph,
    Input,
    Item,
    Leaf,
    Output,
    Pack,
    node_address,
    parse_address,
)
from dextera_build.store.headers import collection_header, file_header, folder_header
from tests.engine.tiny import _output, follow, text_header

Labels = tuple[str, ...]


def _leaf(path: Path) -> bytes:
    if path.is_file():
        return file_header(digest.of_bytes(path.read_bytes()), path.stat().st_size)
    files = {file.relative_to(path).as_posix(): file.read_bytes() for file in path.rglob("*") if file.is_file()}
    return folder_header({name: (digest.of_bytes(data), len(data)) for name, data in files.items()})


@dataclass
class Reference:
    """One run over one graph; `cache` lives on between runs."""

    graph: Graph
    cache: dict[str, str]
    blobs: Any = field(init=False)
    store: dict[str, bytes] = field(default_factory=dict)
    keys: dict[str, str] = field(default_factory=dict)
    """Node -> key, for nodes whose inputs are known."""
    outputs: dict[str, str | None] = field(default_factory=dict)
    """Node -> output; None for one that failed or waits."""
    ran: set[str] = field(default_factory=set)
    """Keys that had to run."""
    failed: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.blobs = self

    def put(self, data: bytes) -> str:
        key = digest.of_bytes(data)
        self.store[key] = data
        return key

    def build(self, targets: list[Address]) -> None:
        for target in targets:
            for labels in self.copies(target.call, ()) or ():
                if target.matches(labels):
                    self.node(target.call, labels)

    def ok(self, targets: list[Address]) -> bool:
        """Whether all copies that `targets` name are built, apart from those that groups leave out."""
        return all(self._is_built(target) for target in targets) and "go_on" not in map(self.effect, self.failed)

    def effect(self, address: str) -> str:
        """What the failure of a node does to the run."""
        path = parse_address(address).call
        around = {self.member(path[:depth]).on_failure for depth in range(1, len(path))}
        own = self.call(path, parse_address(address).labels or ()).on_failure
        return next((effect for effect in ("leave_out", "go_on") if effect in {*around, own}), "stop")

    def _is_built(self, target: Address) -> bool:
        outside = len(target.labels or ())
        copies = self.copies(target.call, ())
        missing = [c for c in copies or () if target.matches(c) and self.node(target.call, c) is None]
        return copies is not None and (not missing or self.is_lenient(target.call, outside))

    def node(self, path: tuple[str, ...], labels: Labels) -> str | None:
        address = node_address(path, labels)
        if address not in self.outputs:
            call = self.call(path, labels)
            inputs = {slot: self.value(source, path[:-1], labels) for slot, source in call.inputs.items()}
            self.outputs[address] = None if None in inputs.values() else self.result(address, call, inputs)
        return self.outputs[address]

    def member(self, path: tuple[str, ...]) -> Any:
        found: Any = self.graph
        for name in path:
            found = found.members[name]
        return found

    def call(self, path: tuple[str, ...], labels: Labels) -> Call:
        own = self.member(path[:-1]).overrides.get(labels[-1], {}) if labels else {}
        found: Call = own.get(path[-1], self.member(path))
        return found

    def result(self, address: str, call: Call, inputs: dict[str, Any]) -> str | None:
        rule = call.rule
        key = self.keys[address] = repr(
            (rule.path, rule.version, rule.code, call.options, call.salt, sorted(inputs.items()))
        )
        if rule.discovers:
            return self.discovered(address, call)
        if call.options["do"] == "fail":
            self.failed.add(address)
            return None
        if key not in self.cache:
            self.ran.add(key)
            self.cache[key] = self.put(_output(call.options, inputs, self))  # type: ignore[arg-type]
        else:
            self.put(_output(call.options, inputs, self))  # type: ignore[arg-type]
        return self.cache[key]

    def discovered(self, address: str, call: Call) -> str | None:
        """A call that reads by itself is made of all that it was told."""
        if call.options["do"] == "fail":
            self.failed.add(address)
            return None
        folder = Path(call.options["value"]["folder"])  # type: ignore[index]
        told: list[object] = []

        def noted(answer: Any) -> Any:
            told.append(answer)
            return answer

        seen = follow(
            call.options["value"]["start"],  # type: ignore[index]
            lambda name: noted((folder / name).exists()),
            lambda name: noted((folder / name).read_text()),
            lambda pattern: noted(sorted(path.name for path in folder.glob(pattern) if path.is_file())),
        )
        key = self.keys[address] = f"{self.keys[address]} {told}"
        output = self.put(text_header(seen))
        if key not in self.cache:
            self.ran.add(key)
        self.cache[key] = output
        return output

    def value(self, source: Input, scope: tuple[str, ...], labels: Labels) -> str | None:
        if isinstance(source, Pack):
            return self.listed(source, scope, labels)
        if isinstance(source, Leaf):
            return self.put(_leaf(Path(source.path)))
        if isinstance(source, Item):
            level = len(source.group)
            found = self.items(source.group, labels[: level - 1])
            return found[labels[level - 1]] if found is not None else None
        if isinstance(source, Output):
            return self.node(source.call, labels[: len(source.call) - 1])
        shared = 0
        while shared < min(len(scope), len(source.call) - 1) and scope[shared] == source.call[shared]:
            shared += 1
        copies = self.copies(source.call, labels[:shared])
        parts = {".".join(c[shared:]): self.node(source.call, c) for c in copies or ()}
        if self.is_lenient(source.call, shared):
            parts = {label: part for label, part in parts.items() if part is not None}
        if copies is None or None in parts.values():
            return None
        return self.put(collection_header({label: str(part) for label, part in parts.items()}))

    def listed(self, pack: Pack, scope: tuple[str, ...], labels: Labels) -> str | None:
        """A listed collection, without the entries that lenient calls failed to give, unless these are all."""
        found = {label: self.value(part, scope, labels) for label, part in pack.parts.items()}
        lost = [pack.parts[label] for label, value in found.items() if value is None]
        lenient = [isinstance(part, Output) and self.own_effect(part, labels) != "stop" for part in lost]
        kept = {label: value for label, value in found.items() if value is not None}
        return self.put(collection_header(kept)) if kept and all(lenient) else None

    def own_effect(self, part: Output, labels: Labels) -> str:
        """What the recipe says of a call's own failure."""
        return self.call(part.call, labels[: len(part.call) - 1]).on_failure

    def copies(self, call: tuple[str, ...], labels: Labels) -> list[Labels] | None:
        """All label tuples of a call below `labels`; None where a group cannot be opened."""
        found: list[Labels] = [labels]
        whole = True
        for depth in range(len(labels), len(call) - 1):
            opened = [(each, self.items(call[: depth + 1], each)) for each in found]
            # A group that cannot be opened is left out with the copy of the lenient group around it.
            whole = whole and (
                self.is_lenient(call[: depth + 1], len(labels)) or all(items is not None for _, items in opened)
            )
            found = [(*each, label) for each, items in opened for label in items or {}]
        if not whole:  # a build still asks for the copies that it knows
            for each in found:
                self.node(call, each)
            return None
        return found

    def is_lenient(self, path: tuple[str, ...], outside: int) -> bool:
        return any(self.member(path[:depth]).on_failure != "stop" for depth in range(outside + 1, len(path)))

    def items(self, path: tuple[str, ...], labels: Labels) -> dict[str, str] | None:
        listed = self.member(path).over
        if isinstance(listed, Fixed):
            return dict.fromkeys(listed.labels, "")
        over = self.value(listed, path[:-1], labels)
        if over is None:
            return None
        return {label: ref["$ref"] for label, ref in json.loads(self.store[over])["fields"]["items"]["$map"].items()}

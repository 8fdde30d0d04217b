"""Nodes with discovered inputs: finds the result whose trace matches the current files, here and on remotes."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias

from dextera_build import digest as digests
from dextera_build.engine.key import Writer
from dextera_build.engine.units import Node
from dextera_build.errors import RuleError
from dextera_build.store import traces
from dextera_build.store.blobs import MissingBlob
from dextera_build.store.entry import ActionResult
from dextera_build.store.questions import Look
from dextera_build.store.results import Found
from dextera_build.store.store import Store
from dextera_build.store.traces import Step, Steps

Question: TypeAlias = tuple[str, str, str]
"""Folder of the project, kind, name."""


class Reading:
    """The discovered inputs of one run; each question is answered once.

    Args:
        store: Holds results.
        writer: Writes key documents.
    """

    def __init__(self, store: Store, writer: Writer) -> None:
        self._store, self._writer = store, writer
        self._looks: dict[str, Look] = {}
        self._told: dict[Question, str] = {}

    def find(self, node: Node) -> Found | None:
        """Look a node up in the store; with discovered inputs, its key depends on the files it would read."""
        if not node.rule.discovers:
            return self._store.actions.find(node.key or "")
        held = self._store.actions.find(node.key or "") if self.follow(node) else None
        if held is None:
            self.begin(node)
        return held

    def is_missing(self, node: Node) -> bool:
        """Whether the store has no entry for a node; a quick check, always False with discovered inputs."""
        return not node.rule.discovers and self._store.actions.entry(node.key or "") is None

    def whole(self, node: Node) -> ActionResult | None:
        """The result of a node with all its bytes, or None."""
        found = self.find(node)
        return found.result if found is not None and found.is_whole else None

    def document(self, node: Node) -> bytes:
        """The key document of a node, with its trace if known."""
        if node.rule.discovers:
            return traces.spelled(self._static(node), node.reads)
        return self._writer.document(node.call, node.inputs)

    def begin(self, node: Node) -> None:
        """Give a node its static key, under which remotes list traces."""
        self._take(node, None, traces.spelled(self._static(node), None))

    def follow(self, node: Node) -> bool:
        """Give a node the key of the trace that matches, even if the store lacks its result; False if none matches."""
        static = self._static(node)
        steps = traces.fitting(self._store, static, self._answers(node))
        if steps is not None:
            self._take(node, steps, traces.spelled(static, steps))
        return steps is not None

    def ran(self, node: Node, reply: Mapping[str, Any]) -> None:
        """Give a node the key with its trace, after it ran.

        Raises:
            RuleError: A file that it read changed while it ran, or had already been read with other content.
        """
        steps: Steps = tuple((str(kind), str(name), str(answer)) for kind, name, answer in reply.get("reads") or ())
        for step in steps:
            if self._changed(node, step):
                raise RuleError(
                    f"`{step[1]}` changed while `{node.address}` ran",
                    code="DXB-B304",
                    where=node.call.where,
                    hint="build again; nothing was stored",
                )
        for kind, name, answer in steps:
            self._told[node.rule.discovers, kind, name] = answer
        self._take(node, steps, traces.spelled(self._static(node), steps))

    def suppose(self, node: Node, last: str) -> None:
        """Predict a stale node's key by assuming it reads the same files as under `last`; None if unknown."""
        if not node.rule.discovers:
            return
        try:
            parts = traces.parts_of(self._store.blobs.get(last)) if last else None
        except (MissingBlob, ValueError):
            parts = None
        if parts is None or parts[1] is None:
            node.key = None
            return
        now = self._look(node).answer_or_unknown
        steps = tuple((kind, name, now(kind, name)) for kind, name, _ in parts[1])
        self._take(node, steps, traces.spelled(self._static(node), steps))

    def watch(self, node: Node, steps: object) -> None:
        """Look at the files that a failed node read, so that the snapshot watches them."""
        for kind, name, _ in steps if isinstance(steps, list) else ():
            self._look(node).answer_or_unknown(str(kind), str(name))

    def forget(self, node: Node) -> None:
        """Forget the answers a node was given."""
        for kind, name, _ in node.reads or ():
            self._told.pop((node.rule.discovers, kind, name), None)

    def _changed(self, node: Node, step: Step) -> bool:
        kind, name, answer = step
        if self._told.get((node.rule.discovers, kind, name), answer) != answer:
            return True
        return self._look(node).answer_or_unknown(kind, name) != answer

    def _answers(self, node: Node) -> traces.Answer:
        look = self._look(node)

        def answer(kind: str, name: str) -> str:
            question = (node.rule.discovers, kind, name)
            if question not in self._told:
                self._told[question] = look.answer(kind, name)
            return self._told[question]

        return answer

    def _look(self, node: Node) -> Look:
        root = node.rule.discovers
        if root not in self._looks:
            self._looks[root] = Look(Path(root), self._store.leaves, self._store.root)
        return self._looks[root]

    def _static(self, node: Node) -> dict[str, Any]:
        document: dict[str, Any] = json.loads(self._writer.document(node.call, node.inputs))
        return document

    def _take(self, node: Node, steps: Steps | None, document: bytes) -> None:
        node.reads, node.document = steps, document
        node.key = digests.of_bytes(document)

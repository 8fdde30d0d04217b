"""Why a node is stale, followed from reader to source down to the option, function or file that changed.

A node whose inputs are known has a key document; comparison with that of its last build shows the changes. A changed
input leads to the nodes that made it: their current documents are compared with those named in the log of that build.
A node whose inputs are not known yet is waiting, and the search continues with the nodes that it waits for.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from dextera_build.code import order
from dextera_build.code.order import ORDER
from dextera_build.engine.graph import Call, Gather, Graph, Leaf, parse_address
from dextera_build.engine.key import Change, compare
from dextera_build.explain.origins import Origins, document
from dextera_build.explain.reads import Reads
from dextera_build.explain.upstream import Upstream
from dextera_build.report.wording import count, some
from dextera_build.store.traces import READ

if TYPE_CHECKING:
    from dextera_build.engine.dry import Planned
    from dextera_build.session import Session

_OPEN = "depends on its inputs"


@dataclass
class Cause:
    """One cause; the causes behind it follow at a greater depth."""

    kind: str
    """One of `key.Kind`, or `waits for`, `node`, `file`, `lost`."""
    name: str
    change: str
    place: str = ""
    depth: int = 0
    behind: _Question | None = field(default=None, repr=False)
    inside: list[Cause] = field(default_factory=list, repr=False)
    """Causes behind it that are known already."""

    def to_json(self) -> dict[str, Any]:
        """As plain data, without open questions."""
        return {name: getattr(self, name) for name in ("kind", "name", "change", "place", "depth")}


@dataclass(frozen=True)
class _Question:
    """Why the document of `node` differs from `old`, its key in `run`; without `old`, why the node waits."""

    node: str
    old: str = ""
    run: str = ""


class Causes:
    """Answers for one dry run.

    Args:
        session: The recipe.
        graph: The resolved recipe.
        states: Address -> result of the dry run.
    """

    def __init__(self, session: Session, graph: Graph, states: Mapping[str, Planned]) -> None:
        self._session, self._states = session, states
        self._upstream = Upstream(graph, states)
        self._origins = Origins(session.store)
        self._reads = Reads(session)

    def of(self, node: str) -> list[Cause]:
        """All causes of one node, each followed by the causes behind it."""
        return self._followed(self._question(node))

    def since(self, node: str, key: str) -> list[Cause]:
        """The same, compared with the document of `key` instead of the last build's."""
        return self._followed(_Question(node, key))

    def direct(self, node: str) -> list[Cause]:
        """The changes of one node itself, without the causes behind them."""
        return self._answer(self._question(node))

    def _followed(self, asking: _Question) -> list[Cause]:
        found: list[Cause] = []
        asked: set[str] = set()
        stack = [(0, cause) for cause in reversed(self._answer(asking))]
        while stack:
            depth, cause = stack.pop()
            cause.depth, deeper = depth, list(cause.inside)
            if cause.behind is not None and cause.behind.node in asked:
                if cause.kind == "waits for":
                    continue
                cause.change += ", see above"
            elif cause.behind is not None:
                asked.add(cause.behind.node)
                deeper += self._answer(cause.behind)
            found.append(cause)
            stack += [(depth + 1, inner) for inner in reversed(deeper)]
        return _telling(found)

    def _question(self, node: str) -> _Question:
        """The question about a node that is not up to date; a node that was never built can only wait."""
        entry, state = self._session.past_builds.get(node), self._states.get(node)
        if entry is None or state is None or not state.key_document:
            return _Question(node)
        return _Question(node, entry.key, entry.run)

    def _answer(self, question: _Question) -> list[Cause]:
        state = self._states.get(question.node)
        if state is None or not state.key_document:
            return list(self._waits(question.node))
        if not question.old:
            return []
        old = document(self._session.store, question.old)
        if old is None:
            then = f"of run {question.run} is no longer" if question.run else f"{question.old[:12]} is not"
            return [Cause("lost", question.node, f"its key document {then} in the store")]
        return [self._cause(question, old, change) for change in compare(old, self._document(state, old))]

    def _document(self, state: Planned, old: Mapping[str, Any]) -> dict[str, Any]:
        """The current key document of a node; a stale node is assumed to read the same things as in `old`."""
        now: dict[str, Any] = json.loads(state.key_document)
        return now if state.status == "cached" or READ not in now else self._reads.asked_now(now, old)

    def _cause(self, question: _Question, old: Mapping[str, Any], change: Change) -> Cause:
        cause = Cause(change.kind, change.name, f"{short(change.old)} -> {short(change.new)}")
        call = self._upstream.call(question.node)
        if change.kind == "option":
            cause.place = str(call.option_places.get(change.name.partition(".")[0], call.where))
        elif change.kind == "code":
            file, _, definition = change.name.partition(": ")
            # Of an order, the first statement that has another place.
            first = next(iter(order.names_in(change.new)), "") if definition == ORDER else definition
            found = self._session.project.library.place_of(file, first)
            cause.place = f"{self._session.project.shown(found[0])}:{found[1]}" if found else "(gone)"
            cause.name = f"{definition} of {file}" if definition == ORDER else f"`{definition}` of {file}"
        elif change.kind == "input":
            self._follow(cause, question, call, change)
        elif change.kind == "read":
            cause.change, files = self._reads.change(change.name, old, change.old, change.new)
            cause.inside = [Cause("file", name, what) for name, what in files.items()]
        elif change.kind in ("backend", "companion", "salt", "version"):
            cause.place = str(call.where)
        return cause

    def _follow(self, cause: Cause, question: _Question, call: Call, change: Change) -> None:
        """Add the origin of a changed input, and the next questions about it."""
        source = call.inputs.get(change.name)
        if isinstance(source, Leaf):
            cause.place = self._session.project.shown(source.path)
            old, new = self._origins.contents(str(change.old)), self._origins.contents(str(change.new))
            cause.inside = list(_files(old, new, cause.place)) if "" not in new else []
            return
        now = self._upstream.nodes(question.node, source) if source is not None else []
        cause.place = some(dict.fromkeys(".".join(parse_address(node).call) for node in now), 3) or str(call.where)
        event = self._origins.event(question.old, question.run)
        if change.old is None or change.new is None or event is None:
            return
        before = self._origins.made_for(event)
        if isinstance(source, Gather):
            cause.change += _copies(now, before, source)
        changed = [
            _Question(node, before[node]["key"], event["run"])
            for node in now
            if node in before and node in self._states and self._states[node].key != before[node]["key"]
        ]
        groups = self._alike(changed)
        if len(groups) == 1:
            cause.behind = groups[0][0]
        else:
            cause.inside = [Cause("node", _names(group), "changed", behind=group[0]) for group in groups]

    def _alike(self, questions: Sequence[_Question]) -> list[list[_Question]]:
        """Group the copies of one call that have the same changes."""
        groups: dict[tuple[object, ...], list[_Question]] = {}
        for question in questions:
            state, old = (
                self._states[question.node],
                document(self._session.store, question.old) if question.old else None,
            )
            changes = compare(old, self._document(state, old)) if old and state.key_document else []
            shape = [(c.kind, c.name, "" if c.kind == "input" else [c.old, c.new]) for c in changes]
            call = parse_address(question.node).call
            groups.setdefault((call, self._status(question.node), json.dumps(shape)), []).append(question)
        return list(groups.values())

    def _waits(self, node: str) -> Iterator[Cause]:
        """The nodes that a node waits for: its inputs, and the nodes that open its groups."""
        read = {f"input `{slot}`": sources for slot, sources in self._upstream.read_by(node).items()}
        told: set[str] = set()
        for place, sources in (read | {"its group": self._upstream.openers(node)}).items():
            waiting = [name for name in sources if name not in told and self._states[name].status != "cached"]
            told.update(waiting)
            for group in self._alike(list(map(self._question, waiting))):
                yield Cause("waits for", _names(group), self._status(group[0].node), place, behind=group[0])

    def _status(self, node: str) -> str:
        state, entry = self._states[node], self._session.past_builds.get(node)
        if state.status == "unknown":
            return _OPEN
        if entry is None:
            return "never built"
        return "stale" if state.key != entry.key else "no longer in the store"


def _telling(causes: Sequence[Cause]) -> list[Cause]:
    """Drop waiting nodes that lead to no further cause."""
    kept: list[Cause] = []
    for cause in reversed(causes):
        leads_on = bool(kept) and cause.depth < kept[-1].depth
        if leads_on or cause.kind != "waits for" or cause.change != _OPEN:
            kept.append(cause)
    return kept[::-1]


def _files(old: Mapping[str, str], new: Mapping[str, str], folder: str) -> Iterator[Cause]:
    """The changed files of a folder."""
    for name in sorted({*old, *new}):
        if old.get(name) != new.get(name):
            change = f"{short(old[name])} -> {short(new[name])}" if name in old and name in new else ""
            yield Cause("file", name, change or ("added" if name in new else "removed"), f"{folder}/{name}")


def _copies(now: Iterable[str], before: Iterable[str], source: Gather) -> str:
    """The copies that a gathered input gained or lost."""
    fresh, then = ({node for node in nodes if parse_address(node).call == source.call} for nodes in (now, before))
    told = {"new": sorted(fresh - then), "gone": sorted(then - fresh)} if then else {}
    return "".join(f"; {word}: {some(nodes, 3)}" for word, nodes in told.items() if nodes)


def _names(questions: Sequence[_Question]) -> str:
    first, more = questions[0].node, len(questions) - 1
    return f"{first} and {count(more, 'more copy', 'more copies')}" if more else first


def short(value: object) -> str:
    """A value of a key document as one cell: eight digits of a digest, sixty characters of anything else."""
    text = value if isinstance(value, str) and value else json.dumps(value)
    is_digest = isinstance(value, str) and len(value) >= 16 and not set(value) - set("0123456789abcdef")
    return text[:8] if is_digest else text if len(text) <= 60 else f"{text[:57]}..."

"""Everything that a result came from: nodes with rule, options, seeds, code and packages, down to project files."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from dextera_build import digest as digests
from dextera_build.errors import DxbError
from dextera_build.explain import calls
from dextera_build.explain.origins import Origin, Origins, margin
from dextera_build.explain.reads import Reads
from dextera_build.session import Session

Row = dict[str, Any]
_SHORT = 12
_WIDE = 120
"""Characters of an option's value in the text; `--json` has all of it."""


@dataclass
class Lineage:
    """Nodes and files, each once, and which of them read which."""

    roots: list[str] = field(default_factory=list)
    """Ids of what was asked for."""
    nodes: dict[str, Row] = field(default_factory=dict)
    """Id (key, or digest of a file) -> what is known."""
    edges: list[Row] = field(default_factory=list)
    """`from` is read by `to` as its input `slot`; `part` leads to it in what `from` returned."""

    def to_json(self) -> Row:
        """A flat list of nodes, and of edges."""
        return {"roots": self.roots, "nodes": list(self.nodes.values()), "edges": self.edges}


def trace(session: Session, targets: Sequence[str]) -> Lineage:
    """The lineage of what `targets` returned when they were built last.

    Raises:
        UsageError: A target was never built.
    """
    origins, lineage = Origins(session), Lineage()
    todo: list[tuple[str, str, str]] = []
    for node in targets:
        entry = session.past(node)
        lineage.roots.append(entry.key)
        todo.append((entry.key, node, entry.run))
    while todo:
        key, node, run = todo.pop()
        if key in lineage.nodes:
            continue
        event = origins.event(key, run)
        run = event["run"] if event else run
        node = node or (event["node"] if event else "")
        document = origins.document(key)
        lineage.nodes[key] = _node(session, key, node, document)
        for slot, digest in (document or {}).get("inputs", ()):
            for place, origin in _spread(slot, origins.of(key, slot, digest, run)):
                name = origin.key or origin.digest
                lineage.edges.append(
                    {"from": name, "to": key, "slot": place, "part": origin.part, "digest": origin.digest}
                )
                if origin.key:
                    todo.append((origin.key, origin.node, run))
                else:
                    lineage.nodes.setdefault(name, _leaf(session, origin, node or key[:_SHORT]))
    return lineage


def lines(lineage: Lineage, recipe: str) -> Iterator[str]:
    """Indented text, cells separated by tabs; what was printed before is named and not printed again."""
    inputs: dict[str, list[Row]] = {}
    for edge in lineage.edges:
        inputs.setdefault(edge["to"], []).append(edge)
    printed: set[str] = set()
    todo = [(0, f"{recipe}:", "", name) for name in reversed(lineage.roots)]
    while todo:
        depth, before, part, name = todo.pop()
        indent, row = margin(depth), lineage.nodes[name]
        again = name in printed
        yield indent + before + _head(row, part, again)
        if again:
            continue
        printed.add(name)
        yield from (f"{margin(depth + 1)}{detail}" for detail in _details(row))
        for edge in reversed(inputs.get(name, [])):
            todo.append((depth + 1, f"{edge['slot']} <- ", edge["part"], edge["from"]))


def _spread(slot: str, origin: Origin) -> Iterator[tuple[str, Origin]]:
    """The origin, or those of a collection's items: `shards[0]`, ..."""
    if not origin.items:
        yield slot, origin
    for label, item in origin.items.items():
        yield from _spread(f"{slot}[{label}]", item)


def _node(session: Session, key: str, node: str, document: Row | None) -> Row:
    known = session.store.actions.known(key)
    row: Row = {"id": key, "kind": "node", "node": node, "key": key, "output": known.output if known else None}
    again = f"`dxb build '{session.recipe}{':' + node if node else ''}'` makes it again"
    if document is None:
        return row | {"missing": f"its key document is not in the store; {again}"}
    if known is None:
        row["missing"] = f"its result is not in the store; {again}"
    else:
        row |= {"line": known.line, "calls": calls.of_result(session.store, known)}
    options = _flat(document["options"])
    return row | {
        "rule": document["rule"],
        "version": document["version"],
        "backend": document["backend"],
        "options": document["options"],
        "set": {name: value for name, value in options.items() if name not in _defaults(session, document, options)},
        "seeds": {name: value for name, value in options.items() if "seed" in name.rpartition(".")[2]},
        "code": {
            "digest": digests.of_value(document["code"]),
            "files": {file: digests.of_value(parts) for file, parts in document["code"].items()},
        },
        "packages": document["packages"],
        "weights": document["weights"],
        "reads": Reads(session).rows(document),
    }


def _defaults(session: Session, document: Row, options: Mapping[str, Any]) -> set[str]:
    """Options that have the value which the rule gives them by itself; none where the rule is gone."""
    from pydantic_core import to_jsonable_python

    try:
        fields = session.project.library.find(str(document["rule"])).rule.options.model_fields
    except DxbError:
        return set()
    given = {
        name: info.get_default(call_default_factory=True) for name, info in fields.items() if not info.is_required()
    }
    plain = _flat({name: to_jsonable_python(value) for name, value in given.items()})
    same = digests.canonical
    return {name for name, value in options.items() if name in plain and same(value) == same(plain[name])}


def _leaf(session: Session, origin: Origin, reader: str) -> Row:
    row: Row = {"id": origin.digest, "kind": "file" if "" in origin.files else "folder", "digest": origin.digest}
    if origin.path:
        return row | {"path": origin.path, "files": dict(origin.files)}
    again = f"`dxb build '{session.recipe}' --force '{reader}'` reads or makes it again"
    return row | {"kind": "unknown", "missing": f"the store has no record of its origin; {again}"}


def _head(row: Row, part: str, again: bool) -> str:
    if row["kind"] != "node":
        name = row.get("path") or f"?\tdigest {row['digest'][:_SHORT]}"
        return f"{name}\t(above)" if again else "\t".join([name, *_leaf_cells(row)])
    name = (row["node"] or f"key {row['key'][:_SHORT]}") + part
    if again:
        return f"{name}\t(above)"
    cells = [name, f"{row['rule']} version {row['version']}" if "rule" in row else "?", row.get("backend") or "-"]
    output = f"output {row['output'][:_SHORT]}" if row["output"] else "output -"
    return "\t".join([*cells, f"key {row['key'][:_SHORT]}", output, row.get("line") or ""]).rstrip()


def _leaf_cells(row: Row) -> list[str]:
    if row["kind"] == "unknown":
        return [row["missing"]]
    return ["file", f"sha256 {row['files']['']}"] if row["kind"] == "file" else ["folder", f"{len(row['files'])} files"]


def _details(row: Row) -> Iterator[str]:
    if row["kind"] == "folder":
        yield from (f"{name}\tsha256 {blob}" for name, blob in row["files"].items())
    if row["kind"] != "node":
        return
    if "missing" in row:
        yield f"missing\t{row['missing']}"
    if "rule" not in row:
        return
    yield from (f"option {name}\t{_brief(value)}" for name, value in row["set"].items() if name not in row["seeds"])
    yield from (f"seed {name}\t{json.dumps(value)}" for name, value in row["seeds"].items())
    yield f"code {row['code']['digest'][:_SHORT]}\t{len(row['code']['files'])} files"
    yield from (f"package {name}\t{version}" for name, version in row["packages"].items())
    yield from (f"weights {name}" for name in row["weights"])
    yield from (f"read {name}\t{answer}" for name, answer in row["reads"].items())
    for call in row.get("calls", ()):
        yield f"call {call['call'][:_SHORT]}\t{call.get('service', '?')} {call.get('model', '')}".rstrip()


def _brief(value: object) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= _WIDE else f"{text[: _WIDE - 3]}..."


def _flat(options: Mapping[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    stack = [*options.items()][::-1]
    while stack:
        name, value = stack.pop()
        if isinstance(value, dict) and value:
            stack += [(f"{name}.{inner}", item) for inner, item in [*value.items()][::-1]]
        else:
            found[name] = value
    return found

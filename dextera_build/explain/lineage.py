"""The lineage of a result: nodes with rule, options, code and packages, down to project files."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from dextera_build import digest as digests
from dextera_build.engine.key import flat
from dextera_build.explain import calls
from dextera_build.explain.origins import Event, Origin, Origins, document, margin
from dextera_build.explain.reads import Reads
from dextera_build.session import Session

Row = dict[str, Any]
_SHORT = 12
_WIDE = 120
"""Maximum length of an option's value in the text [characters]; `--json` has all of it."""


def trace(session: Session, targets: Sequence[str]) -> Row:
    """The lineage of the last outputs of `targets`, as plain data.

    `roots` are the ids of the targets. `nodes` are nodes and files, each once; `id` is a key, or the digest of a
    file. In `edges`, `to` reads `from` as its input `slot`; `part` is the path to it in the output of `from`.

    Raises:
        UsageError: A target was never built.
    """
    origins = Origins(session.store)
    nodes: dict[str, Row] = {}
    edges: list[Row] = []
    past = {node: session.past(node) for node in targets}
    todo = [origins.event(e.key, e.run) or _unlogged(session, node, e.key) for node, e in past.items()]
    while todo:
        event = todo.pop()
        key = event["key"]
        if key in nodes:
            continue
        nodes[key] = _node(session, event)
        for origin in origins.of(event):
            name = origin.maker["key"] if origin.maker else origin.digest
            edges.append({"from": name, "to": key, "slot": origin.slot, "part": origin.part, "digest": origin.digest})
            if origin.maker:
                todo.append(origin.maker)
            else:
                nodes.setdefault(name, _leaf(session, origin, origins.contents(name), event["node"]))
    return {"roots": [entry.key for entry in past.values()], "nodes": list(nodes.values()), "edges": edges}


def lines(lineage: Row, recipe: str) -> Iterator[str]:
    """Indented text, cells separated by tabs; repeated items are only named."""
    inputs: dict[str, list[Row]] = {}
    nodes = {row["id"]: row for row in lineage["nodes"]}
    for edge in lineage["edges"]:
        inputs.setdefault(edge["to"], []).append(edge)
    printed: set[str] = set()
    todo = [(0, f"{recipe}:", "", name) for name in reversed(lineage["roots"])]
    while todo:
        depth, before, part, name = todo.pop()
        row = nodes[name]
        title, *cells = _head(row)
        title = f"{margin(depth)}{before}{title}{part}"
        if name in printed:
            yield f"{title}\t(above)"
            continue
        printed.add(name)
        yield "\t".join([title, *cells]).rstrip()
        yield from (f"{margin(depth + 1)}{detail}" for detail in _details(row))
        for edge in reversed(inputs.get(name, [])):
            todo.append((depth + 1, f"{edge['slot']} <- ", edge["part"], edge["from"]))


def _unlogged(session: Session, node: str, key: str) -> Event:
    """A node that is in no log; its key document has its inputs, but not their origins."""
    read = dict((document(session.store, key) or {}).get("inputs", ()))
    return {"node": node, "key": key, "output": None, "run": "", "inputs": read, "depends_on": [], "files": {}}


def _node(session: Session, event: Event) -> Row:
    key, node = event["key"], event["node"]
    result, known = session.store.actions.known(key), document(session.store, key)
    row: Row = {"id": key, "kind": "node", "node": node, "key": key, "output": event["output"]}
    if known is None or result is None:
        lost = "key document" if known is None else "result"
        again = f"`dxb build '{session.recipe}:{node}'` makes it again"
        row["missing"] = f"its {lost} is not in the store; {again}"
    if result is not None:
        row |= {"output": result.output, "line": result.line, "calls": calls.of_result(session.store, result)}
    if known is None:
        return row
    files = {file: digests.of_value(parts) for file, parts in known["code"].items()}
    copied = {name: known[name] for name in ("rule", "version", "backend", "options", "packages", "weights")}
    code = {"digest": digests.of_value(known["code"]), "files": files}
    return row | copied | {"code": code, "reads": Reads(session).rows(known)}


def _leaf(session: Session, origin: Origin, files: Mapping[str, str], reader: str) -> Row:
    row: Row = {"id": origin.digest, "kind": "file" if "" in files else "folder", "digest": origin.digest}
    if origin.path:
        return row | {"path": origin.path, "files": dict(files)}
    again = f"`dxb build '{session.recipe}' --force '{reader}'` reads or makes it again"
    return row | {"kind": "unknown", "missing": f"the store has no record of its origin; {again}"}


def _head(row: Row) -> list[str]:
    """The cells of a line: the name, then details."""
    if row["kind"] == "unknown":
        return ["?", f"digest {row['digest'][:_SHORT]}", row["missing"]]
    if row["kind"] == "file":
        return [row["path"], "file", f"sha256 {row['files']['']}"]
    if row["kind"] == "folder":
        return [row["path"], "folder", f"{len(row['files'])} files"]
    made = [f"{row['rule']} version {row['version']}", row["backend"] or "-"] if "rule" in row else ["?", "-"]
    output = f"output {row['output'][:_SHORT]}" if row["output"] else "output -"
    return [row["node"], *made, f"key {row['key'][:_SHORT]}", output, row.get("line") or ""]


def _details(row: Row) -> Iterator[str]:
    if row["kind"] == "folder":
        yield from (f"{name}\tsha256 {blob}" for name, blob in row["files"].items())
    if row["kind"] == "node" and "missing" in row:
        yield f"missing\t{row['missing']}"
    if "rule" in row:
        yield from (f"option {name}\t{_brief(value)}" for name, value in sorted(flat(row["options"]).items()))
        yield f"code {row['code']['digest'][:_SHORT]}\t{len(row['code']['files'])} files"
        yield from (f"package {name}\t{version}" for name, version in row["packages"].items())
        yield from (f"weights {name}" for name in row["weights"])
        yield from (f"read {name}\t{answer}" for name, answer in row["reads"].items())
    for call in row.get("calls", ()):
        yield f"call {call['call'][:_SHORT]}\t{call.get('service', '?')} {call.get('model') or ''}".rstrip()


def _brief(value: object) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= _WIDE else f"{text[: _WIDE - 3]}..."

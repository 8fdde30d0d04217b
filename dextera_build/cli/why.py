"""`dxb why`: what a node's staleness comes from, down to the option's line or the changed function."""

from __future__ import annotations

import argparse
import json
import time
from typing import TYPE_CHECKING, Any

from dextera_build.cli import options
from dextera_build.errors import UsageError

if TYPE_CHECKING:
    from dextera_build.cli.session import Session
    from dextera_build.engine.dryrun import Planned
    from dextera_build.engine.graph import Call, Graph
    from dextera_build.engine.key import Change

Row = dict[str, str]


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument("node", metavar="RECIPE:NODE", help="twin/laptop_scene:body[mug].mesh")
    options.project_arguments(parser)
    options.request_arguments(parser)
    options.json_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Print a sentence, then one cause a line: kind, name, old -> new, place."""
    from dextera_build.cli.session import Session, addresses
    from dextera_build.engine.dryrun import plan

    project = options.project(args)
    wanted = options.wish(args.node)
    if not wanted.target:
        raise UsageError(
            "name a node", code="DXB-U111", hint=f"`dxb why {wanted.recipe}:NODE`; `dxb ls {wanted.recipe}`"
        )
    session = Session(project, wanted.recipe)
    graph = session.plan(options.request(args, project.profile)).graph
    found = plan(graph, addresses(graph, wanted.target), session.store, history=session.past_builds)
    states = {node.address: node for node in found}
    if wanted.target not in states and wanted.target not in session.history:
        raise UsageError(
            f"`{args.node}` is not known yet: its group is not open",
            code="DXB-U114",
            facts={"stale": ", ".join(name for name, node in states.items() if node.status == "stale")},
            hint=f"`dxb build '{args.node}'`",
        )
    sentence, rows = _explain(session, graph, states, wanted.target)
    if args.json:
        print(json.dumps({"node": args.node, "answer": sentence, "causes": rows}, indent=1))
        return 0
    print(sentence)
    for row in rows:
        print(f"  {row['kind']}\t{row['name']}\t{row['change']}\t{row['place']}".rstrip())
    return 0


def _explain(session: Session, graph: Graph, states: dict[str, Planned], node: str) -> tuple[str, list[Row]]:
    from dextera_build.engine.key import compare

    state = states.get(node)
    entry = session.history.get(node)
    when = f"run {entry.run} ({_ago(entry.time)})" if entry else ""
    if state is not None and state.status == "cached":
        builder = when if entry and entry.key == state.key else "an earlier run or another recipe"
        return f"up to date: key {(state.key or '')[:12]}, built by {builder}", []
    if entry is None:
        return "never built", _upstream(states, node)
    if state is None or not state.key_document:
        return f"may be stale: what it depends on is stale since {when}", _upstream(states, node)
    old = session.document(node)
    if state.key == entry.key:
        return f"built by {when}, but the store no longer holds it", []
    changes = compare(old, json.loads(state.key_document))
    call = _call(graph, node)
    return f"stale: {len(changes)} things it depends on changed since {when}", [
        _row(session, call, change) for change in changes
    ]


def _row(session: Session, call: Call, change: Change) -> Row:
    name, place = change.name, ""
    if change.kind == "option":
        where = call.option_places.get(change.name.partition(".")[0], call.where)
        place = str(where)
    elif change.kind == "code":
        file, _, definition = change.name.partition(": ")
        found = session.project.library.code.find(file, definition)
        place = f"{session.project.shown(found[0])}:{found[1]}" if found else "(gone)"
        name = f"`{definition}` of {file}"
    elif change.kind == "input":
        place = _origin(session, call, change.name)
    elif change.kind in ("backend", "salt", "version"):
        place = str(call.where)
    return {
        "kind": change.kind,
        "name": name,
        "change": f"{_short(change.old)} -> {_short(change.new)}",
        "place": place,
    }


def _origin(session: Session, call: Call, slot: str) -> str:
    """The file, or the call, that an input comes from."""
    from dextera_build.engine.graph import Gather, Leaf, Output

    given = call.inputs.get(slot)
    if isinstance(given, Leaf):
        return session.project.shown(given.path)
    return ".".join((*given.call, *given.fields)) if isinstance(given, Output | Gather) else str(call.where)


def _upstream(states: dict[str, Planned], node: str) -> list[Row]:
    return [
        {"kind": "waits for", "name": name, "change": "stale", "place": ""}
        for name, state in states.items()
        if state.status == "stale" and name != node
    ]


def _call(graph: Graph, node: str) -> Call:
    from dextera_build.engine.graph import Group, parse_address

    address = parse_address(node)
    members: Any = graph.members
    for depth, name in enumerate(address.call[:-1]):
        group = members[name]
        assert isinstance(group, Group)
        label = (address.labels or ())[depth]
        members = {**group.members, **group.overrides.get(label, {})}
    found: Call = members[address.call[-1]]
    return found


def _short(value: object) -> str:
    text = value if isinstance(value, str) else json.dumps(value)
    is_digest = isinstance(value, str) and len(value) >= 16 and not set(value) - set("0123456789abcdef")
    return text[:8] if is_digest else text if len(text) <= 60 else f"{text[:57]}..."


def _ago(when: float) -> str:
    seconds = time.time() - when
    for size, name in ((86400, "day"), (3600, "hour"), (60, "minute")):
        if seconds >= size:
            count = int(seconds // size)
            return f"{count} {name}{'s' if count > 1 else ''} ago"
    return "a moment ago"

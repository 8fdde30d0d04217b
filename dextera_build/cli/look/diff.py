"""`dxb diff`: differences between two runs, two nodes or two artifacts."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from dextera_build.cli import options, table
from dextera_build.errors import UsageError, did_you_mean, listing
from dextera_build.explain import compare, runs, summary
from dextera_build.explain.compare import Row, Side
from dextera_build.project.workspace import workspace
from dextera_build.recipe.addresses import parse_target
from dextera_build.runs import log, workspaces
from dextera_build.session import Session, reading

if TYPE_CHECKING:
    from dextera_build.project.project import Project
    from dextera_build.store.store import Store

_MOST = 40
"""Maximum number of lines per node; `--json` has all."""
_SHORTEST = 6
"""Minimum length of a digest prefix [digits]."""


_Run: TypeAlias = tuple[str, runs.Events]
"""A run's name and its events."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument(
        "old",
        metavar="A",
        help="a run (0141), a node (twin/a:scene), a node of a run (0141:scene), or the beginning of the digest of a "
        "key or an output; a single recipe or node: its last two runs",
    )
    parser.add_argument("new", metavar="B", nargs="?", help="the other operand")
    parser.add_argument(
        "--picture",
        metavar="FILE.svg",
        type=Path,
        help="draw by how much poses moved, with their 95 %% intervals, into this file",
    )
    options.project_arguments(parser)
    options.json_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Print a sentence, then one line per difference: [node,] kind, name, change; nothing if all is equal."""
    project = options.project(args)
    store = reading(project)
    old, new = _pair(project, store, args.old, args.new)
    if isinstance(old, Side) and isinstance(new, Side):
        return _print({"": compare.rows(store, old, new)}, (old.name, new.name), None, args)
    if isinstance(old, Side) or isinstance(new, Side):
        raise UsageError(
            "a run cannot be compared with a result",
            code="DXB-U164",
            hint="name two runs, or two results: `dxb diff 0141:NODE 0142:NODE`",
        )
    total = len(compare.nodes(old[1]) | compare.nodes(new[1]))
    return _print(compare.run_rows(store, old[1], new[1]), (old[0], new[0]), total, args)


def _print(
    found: Mapping[str, Sequence[Row]], names: tuple[str, str], total: int | None, args: argparse.Namespace
) -> int:
    told, found = summary.sentence(found, total), summary.first_moved(found)
    if told and not args.json:
        print(told, file=sys.stderr)
    if args.picture is not None:
        _draw(found, names, args.picture)
    plain = [{"node": node, "rows": [row.to_json() for row in rows]} for node, rows in found.items() if rows]
    cells = [
        ({"node": node} if node else {}) | {"kind": row.kind, "name": row.name, "change": row.change}
        for node, rows in found.items()
        for row in rows[:_MOST]
    ]
    content = {"old": names[0], "new": names[1], "summary": told or None, "differences": plain}
    table.give("diff", content, as_json=args.json, cells=cells)
    if args.json:
        return 0
    for node, rows in found.items():
        if len(rows) > _MOST:
            print(f"{node}: {len(rows) - _MOST} more, `--json` has all".removeprefix(": "), file=sys.stderr)
    if not any(found.values()):
        print(f"{names[0]} and {names[1]} are equal", file=sys.stderr)
    return 0


def _draw(found: Mapping[str, Sequence[Row]], names: tuple[str, str], path: Path) -> None:
    from dextera_build.report import moves

    moved = {
        " ".join(part for part in (node, row.name if row.name != "type" else "") if part): row.output.motion
        for node, rows in found.items()
        for row in rows
        if row.output is not None and row.output.motion is not None
    }
    if not moved:
        print(f"no pose differs between {names[0]} and {names[1]}: {path} is not written", file=sys.stderr)
        return
    path.write_text(moves.svg(f"Poses that moved from {names[0]} to {names[1]}", moved) + "\n")
    print(f"{path}: {len(moved)} poses", file=sys.stderr)


def _pair(project: Project, store: Store, old: str, new: str | None) -> tuple[Side | _Run, Side | _Run]:
    """Find two operands; a single recipe or node means its last two runs.

    Raises:
        UsageError: An operand is unknown or ambiguous.
    """
    if new is not None:
        return _find(project, store, old), _find(project, store, new)
    named = parse_target(old)
    mark = workspaces.mark(workspace(project))
    last = list(islice(log.those(store, named.recipe, workspace=mark), 2))
    if len(last) < 2:
        raise UsageError(
            f"`{named.recipe}` has {('no run', 'only one run')[len(last)]} here; a comparison takes two",
            code="DXB-U165",
            hint="`dxb ls runs` lists runs; `dxb diff A B` compares two things",
        )
    texts = [f"{run}:{named.node}" if named.node else run for run in reversed(last)]
    return _find(project, store, texts[0]), _find(project, store, texts[1])


def _find(project: Project, store: Store, text: str) -> Side | _Run:
    """Find one operand.

    Raises:
        UsageError: It is unknown or ambiguous.
    """
    head, colon, node = text.partition(":")
    if head in log.runs(store):
        return _in_run(project, head, node) if colon else (text, runs.find(project, head)[1])
    named = parse_target(text)
    if colon:
        session = Session(project, named.recipe, last=True, node=named.node)
        return Side(text, session.past(named.node).key, session.output(named.node))
    if len(text) >= _SHORTEST and not set(text) - set("0123456789abcdef"):
        return _by_digest(store, text)
    return runs.find(project, named.recipe)


def _in_run(project: Project, run: str, node: str) -> Side:
    _, events = runs.find(project, run)
    ended = {event["node"]: event for event in events if event["event"] == "node_finished"}
    if node not in ended:
        raise UsageError(
            f"run {run} had no node `{node}`",
            code="DXB-U166",
            facts={"nodes": listing(ended, most=30)},
            hint=did_you_mean(node, ended),
        )
    event = ended[node]
    return Side(f"{run}:{node}", event["key"], event["output"], event["status"])


def _by_digest(store: Store, text: str) -> Side:
    # Most key documents are stored in the entries of their keys.
    folders = [root / text[:2] for root in (store.blobs.root, store.actions.root)]
    names = {entry.name for folder in folders if folder.is_dir() for entry in folder.iterdir()}
    found = sorted(text[:2] + name for name in names if name.startswith(text[2:]))
    if len(found) != 1:
        raise UsageError(
            f"the store has {f'{len(found)} blobs' if found else 'nothing'} whose digest begins with `{text}`",
            code="DXB-U167",
            facts={"digests": listing(found)} if found else None,
            hint="give more digits" if found else "`dxb show RECIPE:NODE` prints the key and the output of a node",
        )
    (digest,) = found
    try:
        content = json.loads(store.blobs.get(digest))
    except ValueError:
        content = None
    if isinstance(content, dict) and {"artifact", "fields"} == set(content):
        return Side(text, None, digest)
    if isinstance(content, dict) and {"rule", "options", "code"} <= set(content):
        result = store.actions.known(digest)
        return Side(text, digest, result.output if result else None)
    raise UsageError(
        f"the blob `{text}` is neither a key document nor an artifact",
        code="DXB-U168",
        hint="`dxb show RECIPE:NODE` prints the key and the output of a node",
    )

"""What the operands of `dxb diff` name: runs, nodes, nodes of runs, keys and outputs."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING

from dextera_build.errors import UsageError, did_you_mean, listing
from dextera_build.explain import runs
from dextera_build.explain.compare import Side
from dextera_build.recipe.addresses import parse_target
from dextera_build.runs import log

if TYPE_CHECKING:
    from dextera_build.project.project import Project
    from dextera_build.store.store import Store

_SHORTEST = 6
"""Digits of a digest's beginning."""


@dataclass(frozen=True)
class Run:
    """A run with its events."""

    name: str
    events: runs.Events


def pair(project: Project, store: Store, old: str, new: str | None) -> tuple[Side | Run, Side | Run]:
    """What two operands name; a recipe, or a node of it, alone stands for its last two runs.

    Raises:
        UsageError: An operand names nothing, or several things.
    """
    if new is not None:
        return find(project, store, old), find(project, store, new)
    named = parse_target(old)
    last = [run for run in reversed(log.runs(store)) if _recipe(store, run) == named.recipe][:2]
    if len(last) < 2:
        raise UsageError(
            f"`{named.recipe}` has {('no run', 'one run')[len(last)]} here, and two are compared",
            code="DXB-U165",
            hint="`dxb ls runs` lists runs; `dxb diff A B` compares two things",
        )
    texts = [f"{run}:{named.node}" if named.node else run for run in reversed(last)]
    return find(project, store, texts[0]), find(project, store, texts[1])


def find(project: Project, store: Store, text: str) -> Side | Run:
    """What one operand names.

    Raises:
        UsageError: It names nothing, or several things.
    """
    head, colon, node = text.partition(":")
    if head in log.runs(store):
        return _in_run(project, head, node) if colon else Run(text, runs.find(project, head)[1])
    named = parse_target(text)
    if colon:
        from dextera_build.session import Session

        session = Session(project, named.recipe, last=True)
        return Side(text, session.past(named.node).key, session.output(named.node))
    if len(text) >= _SHORTEST and not set(text) - set("0123456789abcdef"):
        return _by_digest(store, text)
    return Run(*runs.find(project, named.recipe))


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
    # Most key documents lie in the entries of their keys.
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
        f"`{text}` is the beginning of a blob that is neither a key nor an artifact",
        code="DXB-U168",
        hint="`dxb show RECIPE:NODE` prints the key and the output of a node",
    )


def _recipe(store: Store, run: str) -> str | None:
    events = log.read(store, run)
    return str(events[0].get("recipe")) if events else None

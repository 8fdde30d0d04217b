"""`dxb check`: recipes without building them, or one node built again and compared."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from dextera_build.cli import options, table
from dextera_build.errors import DxbError, RuleError, StaleError, UsageError, listing

if TYPE_CHECKING:
    from dextera_build.session import Session


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument(
        "targets",
        nargs="*",
        metavar="RECIPE[:NODE]",
        help="recipes to resolve (all of them without any), or a node to build again and compare",
    )
    options.project_arguments(parser)
    options.request_arguments(parser)
    options.json_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Print one line per recipe; 2 where one is wrong, 1 where a rebuilt node differs."""
    project = options.project(args)
    code, rows = 0, []
    for target in args.targets or [address for address, _ in project.recipes()]:
        try:
            session, node = options.session(args, target, project, last=True)
            found = _repeat(session, node) if node else _resolve(session)
            rows.append({"target": target, "found": found})
        except DxbError as error:
            if args.targets and len(args.targets) == 1:
                raise
            from dextera_build.cli.errors import render

            print(render(error), file=sys.stderr)
            code = max(code, error.exit_code)
            rows += [{"target": target, "error": error.to_json()}] if args.json else []
    table.give(rows, as_json=args.json)
    return code


def _resolve(session: Session) -> str:
    try:
        graph = session.plan().graph
    except UsageError as error:
        if error.code != "DXB-U105":
            raise
        return f"sound, needs an input: {error.message}"
    return f"sound, {len(list(graph.calls()))} calls"


def _repeat(session: Session, node: str) -> str:
    """Run one node on the inputs of its last build, beside the cache, and compare by the tolerance of its rule."""
    from dextera_build.build.runner import run_task

    project, recipe = session.project, session.recipe
    before, document, key = session.output(node), session.document(node), session.past(node).key
    task = {
        "rule": document["rule"],
        "backend": document["backend"],
        "options": document["options"],
        "inputs": dict(document["inputs"]),
        "store": str(project.cache),
        "project": str(project.root),
    }
    absent = [slot for slot, digest in document["inputs"] if not session.store.actions.references.are_here(digest)]
    if absent:
        raise RuleError(
            f"`{recipe}:{node}` cannot be run again: bytes of its inputs are not in the store",
            code="DXB-B403",
            facts={"inputs": listing(absent)},
            hint=f"`dxb build --whole '{recipe}:{node}'`",
        )
    reply = run_task(task, lambda kind, data: None)
    if reply.get("reads", []) != document.get("read", []):
        raise StaleError(
            f"`{recipe}:{node}` reads other files, or other content, than when it was built",
            code="DXB-C104",
            hint=f"`dxb why '{recipe}:{node}'`; `dxb build '{recipe}:{node}'`, then check again",
        )
    after = reply["output"]
    rows = list(_rows(session, str(document["rule"]), key, before, reply))
    if after != before:
        session.store.divergent.note(key, f"{recipe}:{node}", before, after, time.time())
    if any(row.is_beyond for row in rows) or (after != before and not rows):
        raise RuleError(
            f"`{recipe}:{node}` is not deterministic: built again, it came out different",
            code="DXB-B402",
            facts={row.name: str(row) for row in rows} | {"first": before, "again": after},
            hint=f"`dxb diff {before[:12]} {after[:12]}`; look for random numbers, threads or time in the rule",
        )
    if after == before:
        return f"same output again: {after}"
    return f"same within the tolerance of its rule: {'; '.join(f'{row.name} {row}' for row in rows)}"


@dataclass(frozen=True)
class _Row:
    """One field or metric that differs, beside what is allowed."""

    name: str
    largest: float | None
    """None: not a difference of numbers."""
    allowed: float

    @property
    def is_beyond(self) -> bool:
        return self.largest is None or not self.largest <= self.allowed

    def __str__(self) -> str:
        apart = "another form or value" if self.largest is None else f"{self.largest:.3g} apart"
        return f"{apart}, {self.allowed:.3g} allowed"


def _rows(session: Session, rule: str, key: str, before: str, reply: Mapping[str, Any]) -> Iterator[_Row]:
    from dextera_build.artifacts.difference import by_field, differences

    tolerance = session.project.library.find(rule).rule.tolerance
    for field, largest in by_field(differences(before, reply["output"], session.store.blobs.get)).items():
        yield _Row(field or "type", largest, tolerance.fields.get(field, 0.0))
    known = session.store.actions.known(key)
    for name, allowed in tolerance.metrics.items():
        values = [(known.metrics if known else {}).get(name), reply["metrics"].get(name)]
        if values[0] is None or values[1] is None:
            if values != [None, None]:
                yield _Row(f"metric {name}", None, allowed)
        elif (apart := abs(values[0][0] - values[1][0])) > 0:
            yield _Row(f"metric {name}", apart, allowed)

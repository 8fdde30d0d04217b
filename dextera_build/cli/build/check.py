"""`dxb check`: validate recipes and compare results with their bounds, or rebuild one node and compare."""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from dextera_build.cli import options, streams, table
from dextera_build.cli.build import expected
from dextera_build.errors import DxbError, RecipeError, RuleError, StaleError, UsageError, listing
from dextera_build.project import own
from dextera_build.recipe.expect import STAND_INS
from dextera_build.report.wording import count

if TYPE_CHECKING:
    from dextera_build.engine.graph import Graph, Plan
    from dextera_build.project.project import Project
    from dextera_build.session import Session


CALIBRATION = "calibration"
"""The first target that detects whether a camera has moved."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument(
        "targets",
        nargs="*",
        metavar="RECIPE[:NODE]",
        help="recipes to check without building them (those of the project by default), also against the bounds "
        "that they state under `expect` if they are built; or a node to rebuild and compare; `calibration "
        "RECIPE:NODE` builds a node of align.camera_motion: 0 the camera has not moved, 1 it has, 3 unsure",
    )
    parser.add_argument("--all", action="store_true", help="check dxb's own recipes too, which takes a minute or more")
    options.project_arguments(parser)
    options.request_arguments(parser)
    options.json_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Print one line per recipe as its check ends, and at the end one per bound of a recipe.

    Returns 2 if a recipe is wrong, 1 if a bound is missed or a rebuilt node differs, 3 if bounds of a recipe that is
    named cannot be checked because it is not built.
    """
    project = options.project(args)
    if args.targets[:1] == [CALIBRATION]:
        from dextera_build.cli.build import check_calibration

        return check_calibration.run(args, args.targets[1:], project)
    if args.all and args.targets:
        raise UsageError("`--all` checks every recipe", code="DXB-U217", hint="`dxb check --all`, without a recipe")
    targets = args.targets or recipes(project, bundled=args.all)
    code, rows, width = 0, list[dict[str, Any]](), max(map(len, targets), default=0)
    for target in targets:
        rows.append({"target": target, "found": None, "bounds": (), "error": None})
        try:
            _check(args, target, project, rows[-1])
        except DxbError as error:
            rows[-1]["error"] = error.to_json()
            if len(args.targets) == 1:
                _tell(rows[-1], width, as_json=args.json)
                _give(rows, as_json=args.json)
                raise
            from dextera_build.cli.errors import render

            print(render(error), file=sys.stderr)
            code = max(code, error.exit_code)
        except KeyboardInterrupt as interrupt:
            print(f"interrupted after {count(len(rows) - 1, 'check')} of {len(targets)}", file=sys.stderr)
            return streams.code_of(interrupt)
        _tell(rows[-1], width, as_json=args.json)
    _give(rows, as_json=args.json)
    return code


def recipes(project: Project, *, bundled: bool) -> list[str]:
    """The project's own recipes; with `bundled`, or if it has none, dxb's too."""
    return (own.recipes(project) if not bundled else []) or [address for address, _ in project.recipes()]


def _check(args: argparse.Namespace, target: str, project: Project, row: dict[str, Any]) -> None:
    """Fill in the row of one target."""
    session, node = options.session(args, target, project, last=True)
    if node:
        row["found"] = _repeat(session, node)
        return
    plan = session.plan(incomplete=True)
    for error in plan.absent:
        if isinstance(error, RecipeError):
            raise error  # the recipe names a path where nothing is; all else in it is sound
    row["found"] = _resolved(plan)
    if not plan.absent:
        _compare(session, plan.graph, row, needs_all=bool(args.targets))


def _tell(row: Mapping[str, Any], width: int, *, as_json: bool) -> None:
    """Print what was found of one target, at once."""
    if row["found"] is not None and not as_json:
        between = "  " if sys.stdout.isatty() else "\t"
        print(f"{row['target']:{width if sys.stdout.isatty() else 0}}{between}{row['found']}", flush=True)


def _give(rows: Sequence[dict[str, Any]], *, as_json: bool) -> None:
    """Print the document, or the bounds of the recipes that state any."""
    if as_json:
        table.give("check", [{**row, "bounds": expected.rows(row["bounds"])} for row in rows], as_json=True)
        return
    table.show([cell for row in rows for cell in expected.cells(row["bounds"])])


def _compare(session: Session, graph: Graph, row: dict[str, Any], *, needs_all: bool) -> None:
    """Note the bounds of a recipe, compared with its results, in its row; see `expected.refuse`."""
    recipe = session.project.recipe(session.recipe)
    if recipe is None or not recipe.expect:
        return
    if session.project.profile == STAND_INS:
        row["found"] += f", {len(recipe.expect)} bounds not compared: profile `{STAND_INS}` makes stand-ins"
        return
    found = expected.verdicts(session, recipe, graph)
    if found:
        held, absent = sum(each.ok for each in found), sum(each.value is None for each in found)
        told = f"{held} of {len(found)} bounds hold" + (f", {absent} not built" if absent else "")
        shown = [each for each in found if needs_all or each.value is not None]
        row |= {"found": f"{row['found']}, {told}", "bounds": shown}
        expected.refuse(session.recipe, found, needs_all=needs_all)


def _resolved(plan: Plan) -> str:
    if plan.absent:
        return f"sound, needs an input: {plan.absent[0].message}"
    return f"sound, {count(len(list(plan.graph.calls())), 'call')}"


def _repeat(session: Session, node: str) -> str:
    """Run one node on the inputs of its last build, bypassing the cache, and compare within its rule's tolerance."""
    from dextera_build.building.again import again

    recipe = session.recipe
    before, document, key = session.output(node), session.document(node), session.past(node).key
    absent = [slot for slot, digest in document["inputs"] if not session.store.actions.references.are_here(digest)]
    if absent:
        raise RuleError(
            f"`{recipe}:{node}` cannot be run again: bytes of its inputs are not in the store",
            code="DXB-B403",
            facts={"inputs": listing(absent)},
            hint=f"`dxb build --whole '{recipe}:{node}'`",
        )
    reply = again(session.project, document)
    if reply.get("reads", []) != document.get("read", []):
        raise StaleError(
            f"`{recipe}:{node}` cannot be compared: the files that it reads have changed since it was built",
            code="DXB-C104",
            hint=f"`dxb why '{recipe}:{node}'`; `dxb build '{recipe}:{node}'`, then check again",
        )
    after, rows = reply["output"], list(_rows(session, str(document["rule"]), key, before, reply))
    if after != before:
        session.store.divergent.note(key, f"{recipe}:{node}", before, after, time.time())
    if any(row.is_beyond for row in rows) or (after != before and not rows):
        raise RuleError(
            f"`{recipe}:{node}` is not deterministic: rebuilding it gave another output",
            code="DXB-B402",
            facts={row.name: str(row) for row in rows} | {"first": before, "again": after},
            hint=f"`dxb diff {before[:12]} {after[:12]}`; look for random numbers, threads or time in the rule",
        )
    if after == before:
        return f"same output again: {after}"
    return f"same within the tolerance of its rule: {'; '.join(f'{row.name} {row}' for row in rows)}"


class _Row(NamedTuple):
    """A field or a metric that differs."""

    name: str
    apart: float | None
    """None if it is no number, or of another form."""
    allowed: float

    @property
    def is_beyond(self) -> bool:
        return self.allowed < math.inf and (self.apart is None or not self.apart <= self.allowed)

    def __str__(self) -> str:
        what = "another form or value" if self.apart is None else f"{self.apart:.3g} apart"
        return f"{what}, {'not compared' if self.allowed == math.inf else f'{self.allowed:.3g} allowed'}"


def _rows(session: Session, rule: str, key: str, before: str, reply: Mapping[str, Any]) -> Iterator[_Row]:
    """The fields and the metrics with a tolerance that differ."""
    from dextera_build.artifacts.comparison.difference import by_field, differences

    tolerance = session.project.library.find(rule).rule.tolerance
    found = differences(before, reply["output"], session.store.blobs.get, motions=False)
    for field, largest in by_field(found).items():
        yield _Row(field or "type", largest, tolerance.of(field))
    known = session.store.actions.known(key)
    for name, allowed in tolerance.metrics.items():
        old, new = (known.metrics if known else {}).get(name), reply["metrics"].get(name)
        apart = None if old is None or new is None else abs(old[0] - new[0])
        if apart or (apart is None and (old, new) != (None, None)):
            yield _Row(f"metric {name}", apart, allowed)

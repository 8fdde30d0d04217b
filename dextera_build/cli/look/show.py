"""`dxb show`: a node, its lineage, a recipe's last builds, its graph, a run's trace, or the configuration."""

from __future__ import annotations

import argparse
import json
import os
import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from dextera_build.building import part
from dextera_build.cli import options, table
from dextera_build.cli.look import graph, result
from dextera_build.errors import UsageError, did_you_mean
from dextera_build.explain import calls
from dextera_build.explain.calls import is_call
from dextera_build.project import settings
from dextera_build.project.planning import refuse_unknown

if TYPE_CHECKING:
    from dextera_build.project.project import Project
    from dextera_build.session import Session


_DIGEST = re.compile(r"\b([0-9a-f]{12})[0-9a-f]{52}\b")


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument(
        "target",
        nargs="?",
        metavar="RECIPE[:NODE]|RULE|RUN|CALL",
        help="a recipe, a node or target, fields of a result, a rule, a run's id for --trace, or a call by its digest",
    )
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--graph", action="store_true", help="the graph of a recipe or of a target, as SVG")
    what.add_argument("--trace", action="store_true", help="the timeline of a run, for Perfetto or speedscope")
    what.add_argument(
        "--lineage",
        action="store_true",
        help="the origins of a result: nodes with options, code and packages, down to project files",
    )
    what.add_argument("--config", action="store_true", help="every setting with its origin")
    parser.add_argument("-o", "--out", metavar="FILE", help="where to write a graph or trace (standard output)")
    graph.arguments(parser)
    options.project_arguments(parser)
    options.request_arguments(parser)
    options.json_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Print rows of name and value; with `--lineage` one indented line per item, each item once."""
    project = options.project(args)
    _refuse_unused(args)
    if args.trace:
        told = _trace(project, args.target)
        text = table.spelled("show.trace", told) if args.json else json.dumps(told)
        return table.give_text(project, text, args.out, as_json=args.json)
    if args.config:
        return _config(project, as_json=args.json)
    if args.target is None:
        raise UsageError(
            "a recipe, node or rule is missing",
            code="DXB-U111",
            hint="`dxb ls` lists recipes; `--config` shows the settings",
        )
    if args.graph:
        return graph.run(args)
    if _is_rule(project, args.target):
        from dextera_build.explain import rule_card

        file = project.library.find(args.target)
        rows = rule_card.rows(project.library, file)
        content = rule_card.card(project.library, file)
        return table.give("show.rule", content, as_json=args.json, cells=rows, narrow=rule_card.narrow(rows))
    if is_call(args.target):
        found = calls.show(project, args.target)
        return table.give("show.call", found, as_json=args.json, cells=_named(calls.shown(found)))
    _refuse_unlike(project, args.target)
    session, node = options.session(args, args.target, project, last=True)
    if args.lineage:
        return _lineage(session, node, as_json=args.json)
    if not node:
        return _recipe(session, as_json=args.json)
    wanted = part.named(session, node)
    if wanted.fields:
        found = result.part_of(session, wanted)
        cells = _named(result.part_text(found))
        return table.give("show.part", found, as_json=args.json, cells=cells, narrow=shortened(cells))
    found = result.node(session, node)
    cells = _named(result.node_text(found))
    return table.give("show.node", found, as_json=args.json, cells=cells, narrow=shortened(cells))


def _refuse_unused(args: argparse.Namespace) -> None:
    """Refuse flags that change nothing of what is asked for."""
    if args.out and not (args.graph or args.trace):
        raise UsageError(
            "only `--graph` and `--trace` write a file",
            code="DXB-U215",
            hint="`dxb get RECIPE:NODE -o FILE` writes a result",
        )
    if not args.graph and (flag := next(graph.used(args), "")):
        raise UsageError(f"`{flag}` is for `--graph`", code="DXB-U215", hint=f"`dxb show RECIPE --graph {flag} ...`")
    suffix, form = os.path.splitext(args.out or "")[1].lower(), "dot" if args.dot else "svg"
    if args.graph and not args.json and suffix in graph.OTHERS[form]:
        raise UsageError(
            f"the graph is written as {form.upper()}, not as `{suffix}`", code="DXB-U215", hint=f"`-o graph.{form}`"
        )


def _named(rows: Mapping[str, str]) -> list[dict[str, str]]:
    return [{"name": name, "value": value} for name, value in rows.items()]


def shortened(cells: Sequence[Mapping[str, str]]) -> list[dict[str, str]]:
    """The same for a narrow terminal, with the first digits of each digest: a broken one cannot be copied."""
    return [{name: _DIGEST.sub(r"\1", value) for name, value in row.items()} for row in cells]


def _trace(project: Project, run: str | None) -> dict[str, Any]:
    """The timeline of a run's nodes, for Perfetto, Chrome's about:tracing or speedscope."""
    from dextera_build.explain import runs
    from dextera_build.report import run as past
    from dextera_build.report.trace import trace
    from dextera_build.session import reading

    return trace(past.read(runs.find(project, run)[1], reading(project)))


def _is_rule(project: Project, text: str) -> bool:
    """Whether a rule has this address, or had it."""
    from dextera_build.code.renamed import RENAMED

    if "." not in text or set(text) & set(":/"):
        return False
    return text in RENAMED or any(found.path == text for found in project.library.rules())


def _refuse_unlike(project: Project, text: str) -> None:
    """Refuse a name that is no recipe's but like a rule's, `factorize.mash` or `mesh`."""
    if set(text) & set(":/") or project.recipe(text) is not None:
        return
    if near := did_you_mean(text.lower(), [found.path for found in project.library.rules()]):
        raise UsageError(f"no recipe or rule is called `{text}`", code="DXB-U108", hint=near)


def _config(project: Project, *, as_json: bool) -> int:
    """Print every setting as written in `dxb.toml` or on the command line, with its origin."""
    rows = [
        {"setting": name, "value": settings.plain(name, found.value), "origin": found.origin}
        for name, found in project.config.items()
    ]
    cells = [
        {"setting": name, "value": _written(found.value), "origin": found.origin}
        for name, found in project.config.items()
    ]
    return table.give("show.config", rows, as_json=as_json, cells=cells)


def _written(value: Any) -> str:
    if isinstance(value, dict) and all(isinstance(amount, int | float) for amount in value.values()):
        return ",".join(f"{name}={amount:g}" for name, amount in value.items())
    if isinstance(value, dict):
        return json.dumps(value)
    return str(value).lower() if isinstance(value, bool) else str(value)


def _lineage(session: Session, target: str, *, as_json: bool) -> int:
    from dextera_build.explain import lineage

    found = lineage.trace(session, _targets(session, target))
    if as_json:
        return table.give("show.lineage", found, as_json=True)
    print("\n".join(lineage.lines(found, session.recipe)))
    return 0


def _targets(session: Session, target: str) -> list[str]:
    """The built nodes that `target` names: a node, or a target of the recipe."""
    if target in session.history:
        return [target]
    from dextera_build.engine.graph import parse_address
    from dextera_build.session import addresses

    wanted = addresses(session.plan().graph, target)
    built = [(node, parse_address(node)) for node in session.last_nodes]
    found = [node for node, at in built for want in wanted if at.call == want.call and want.matches(at.labels or ())]
    if not found:
        session.past(target or str(wanted[0]))  # raises the error that lists the nodes that were built
    return found


def _recipe(session: Session, *, as_json: bool) -> int:
    """Print the last build of each node of a recipe: time, run, result; results of stub backends are marked."""
    refuse_unknown(session.project, session.recipe)
    rows = [
        {"node": node, "seconds": entry.seconds, "run": entry.run or None, **result.line(session, entry.key)}
        for node, entry in session.history.items()
    ]
    cells = [
        {
            "node": row["node"],
            "time": f"{row['seconds']:.1f} s",
            "run": f"run {row['run'] or ''}",
            "result": result.line_text(row["line"], is_stub=row["stub"]),
        }
        for row in rows
    ]
    name = session.recipe
    none = f"`{name}` was never built here; `dxb plan {name}` says what a build of it would run"
    return table.give("show.recipe", rows, as_json=as_json, cells=cells, none=none)

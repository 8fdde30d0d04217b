"""`dxb show`: a node, its lineage, a recipe's last builds, its graph, a run's trace, or the configuration."""

from __future__ import annotations

import argparse
import json
import time
from typing import TYPE_CHECKING, Any

from dextera_build.building import part
from dextera_build.cli import options, table
from dextera_build.cli.look import graph
from dextera_build.cli.table import give_text
from dextera_build.errors import UsageError
from dextera_build.explain import origins, stubs
from dextera_build.explain.calls import is_call, show
from dextera_build.explain.reads import Reads
from dextera_build.report.wording import STUB, used

if TYPE_CHECKING:
    from dextera_build.project.project import Project
    from dextera_build.session import Session


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
    if args.trace:
        return give_text(project, _trace(project, args.target), args.out)
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

        card = rule_card.rows(project.library, project.library.find(args.target))
        return table.give(card, as_json=args.json, narrow=rule_card.narrow(card))
    if is_call(args.target):
        rows = show(project, args.target)
    else:
        session, node = options.session(args, args.target, project, last=True)
        if args.lineage:
            return _lineage(session, node, as_json=args.json)
        if not node:
            return _recipe(session, as_json=args.json)
        wanted = part.named(session, node)
        rows = _inner(session, wanted) if wanted.fields else _node(session, node)
    cells = [{"name": name, "value": str(value)} for name, value in rows.items()]
    return table.give(rows, as_json=args.json, cells=cells)


def _trace(project: Project, run: str | None) -> str:
    """The timeline of a run's nodes, for Perfetto, Chrome's about:tracing or speedscope."""
    from dextera_build.explain import runs
    from dextera_build.report import run as past
    from dextera_build.report.trace import trace
    from dextera_build.session import reading

    return json.dumps(trace(past.read(runs.find(project, run)[1], reading(project))))


def _is_rule(project: Project, text: str) -> bool:
    """Whether a rule has this address, or had it."""
    from dextera_build.code.renamed import RENAMED

    if "." not in text or set(text) & set(":/"):
        return False
    return text in RENAMED or any(found.path == text for found in project.library.rules())


def _config(project: Project, *, as_json: bool) -> int:
    """Print every setting as written in `dxb.toml` or on the command line, with its origin."""
    rows = {name: {"value": found.value, "origin": found.origin} for name, found in project.config.items()}
    cells = [
        {"setting": name, "value": _written(found.value), "origin": found.origin}
        for name, found in project.config.items()
    ]
    return table.give(rows, as_json=as_json, cells=cells)


def _written(value: Any) -> str:
    if isinstance(value, dict) and all(isinstance(amount, int | float) for amount in value.values()):
        return ",".join(f"{name}={amount:g}" for name, amount in value.items())
    if isinstance(value, dict):
        return json.dumps(value)
    return str(value).lower() if isinstance(value, bool) else str(value)


def _lineage(session: Session, target: str, *, as_json: bool) -> int:
    from dextera_build.explain import lineage

    found = lineage.trace(session, _targets(session, target))
    print(json.dumps(found, indent=1) if as_json else "\n".join(lineage.lines(found, session.recipe)))
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
    if session.project.recipe(session.recipe) is None:
        session.plan()  # raises the error that lists the recipes
    rows = {
        node: {"seconds": entry.seconds, "run": entry.run, "line": _line(session, entry.key)}
        for node, entry in session.history.items()
    }
    cells = [
        {"node": node, "time": f"{row['seconds']:.1f} s", "run": f"run {row['run']}", "result": str(row["line"])}
        for node, row in rows.items()
    ]
    return table.give(rows, as_json=as_json, cells=cells)


def _line(session: Session, key: str) -> str:
    found = session.store.actions.known(key)
    if found is None:
        return "(no longer in the store)"
    return f"(stub) {found.line}" if _backend(session, key) == STUB else found.line


def _backend(session: Session, key: str) -> str | None:
    document = origins.document(session.store, key)
    return document["backend"] if document else None


def _node(session: Session, node: str) -> dict[str, Any]:
    entry = session.past(node)
    found = session.store.actions.find(entry.key)
    document = session.document(node)
    when = f"run {entry.run}, {time.strftime('%Y-%m-%d %H:%M', time.localtime(entry.time))}"
    since = when if entry.run else "a build of another recipe"
    rows: dict[str, Any] = {
        "node": f"{session.recipe}:{node}",
        "result": _line(session, entry.key),
        "rule": f"{document['rule']} version {document['version']}",
        "backend": document["backend"] or "-",
        "known since": f"{since}; it took {entry.seconds:.1f} s to make",
        "key": entry.key,
    }
    if told := stubs.told(session, node):
        rows["stub"] = told
    if entry.usage:
        rows["used"] = used(entry.usage)
    if found is not None:
        result = found.result
        rows["output"] = result.output
        rows |= {} if found.is_whole else {"bytes": "not in the store"}
        rows |= {f"call {number}": key for number, (key, _) in enumerate(result.calls)}
        rows |= {f"metric {name}": f"{value:g} {unit}".strip() for name, (value, unit) in result.metrics.items()}
        rows |= _header(session, result.output)
    rows |= {f"option {name}": json.dumps(value) for name, value in document["options"].items()}
    rows |= {f"input {slot}": digest for slot, digest in document["inputs"]}
    rows |= {f"read {name}": told for name, told in Reads(session).rows(document).items()}
    return rows | {f"package {name}": version for name, version in document["packages"].items()}


def _inner(session: Session, wanted: part.Part) -> dict[str, Any]:
    """A part of a result: its facts and its fields."""
    address = f"{session.recipe}:{wanted.node}"
    rows = {"part": ".".join([address, *wanted.fields]), "of": address}
    rows["result"] = ", ".join(part.artifact(session, wanted).facts())
    if told := stubs.told(session, wanted.node):
        rows["stub"] = told
    digest = part.digest_of(session, wanted)
    return rows | {"digest": digest} | _header(session, digest)


def _header(session: Session, output: str) -> dict[str, Any]:
    header = json.loads(session.store.blobs.get(output))
    rows = {"type": header["artifact"]}
    for name, value in header["fields"].items():
        if isinstance(value, dict) and "$array" in value:
            dtype, shape, _ = value["$array"]
            rows[f"field {name}"] = f"{dtype} {tuple(shape)}"
        elif isinstance(value, dict) and "$ref" in value and session.store.blobs.has(value["$ref"]):
            rows[f"field {name}"] = _part(json.loads(session.store.blobs.get(value["$ref"])))
        elif isinstance(value, dict):
            rows[f"field {name}"] = ", ".join(value.get("$map", {})) or next(iter(value), "").removeprefix("$")
        else:
            text = json.dumps(value)
            rows[f"field {name}"] = text if len(text) < 100 else f"{text[:97]}..."
    return rows


def _part(header: dict[str, Any]) -> str:
    """`Pose, parent world, child object`: an artifact inside another one, without its arrays and parts."""
    plain = {name: value for name, value in header["fields"].items() if isinstance(value, str | int | float)}
    text = ", ".join([header["artifact"], *(f"{name} {value}" for name, value in plain.items())])
    return text if len(text) < 100 else f"{text[:97]}..."

"""`dxb ls`: recipes, rules, backends, profiles, runs, recorded calls, nodes."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from functools import partial

from dextera_build.cli import nodes, options, table
from dextera_build.cli.errors import render, wants_colour
from dextera_build.errors import DxbError, UsageError
from dextera_build.project.project import Project
from dextera_build.report.wording import moment

Row = nodes.Row


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument(
        "what",
        nargs="?",
        default="recipes",
        metavar="WHAT",
        help="recipes (default), rules, backends, profiles, runs, divergent, calls, a recipe's address for its nodes, "
        "or nodes by a glob: 'twin/*:body[*].mesh'",
    )
    nodes.arguments(parser)
    options.project_arguments(parser)
    options.request_arguments(parser)
    options.json_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Print one line per row."""
    from dextera_build.explain import calls
    from dextera_build.explain.runs import runs

    project, wrong = options.project(args), list[DxbError]()
    listings: dict[str, tuple[Callable[[Project], Iterator[Row]], Callable[[Row], Row]]] = {
        "recipes": (partial(_recipes, wrong=wrong), dict),
        "rules": (_rules, dict),
        "backends": (_backends, _backend_cells),
        "profiles": (_profiles, _profile_cells),
        "runs": (runs, _dated),
        "divergent": (_divergent, _divergent_cells),
        "calls": (calls.rows, calls.cells),
    }
    if args.what not in listings:
        return table.give("ls.nodes", list(nodes.rows(project, args)), as_json=args.json)
    if flag := next((name for name in ("deps", "rdeps", "stale", "cached") if getattr(args, name)), ""):
        raise UsageError(
            f"`--{flag}` is for nodes, and `dxb ls {args.what}` lists none",
            code="DXB-U215",
            hint=f"`dxb ls RECIPE --{flag}`",
        )
    listing, cells = listings[args.what]
    rows, none = list(listing(project)), f"there are no {args.what} here"
    table.give(f"ls.{args.what}", rows, as_json=args.json, cells=[cells(row) for row in rows], none=none)
    for error in wrong:
        print(render(error, colour=wants_colour(sys.stderr)), file=sys.stderr)
    return max((error.exit_code for error in wrong), default=0)


def _recipes(project: Project, wrong: list[DxbError]) -> Iterator[Row]:
    """The recipes that can be read; the errors of the others go to `wrong`."""
    for address, _ in project.recipes():
        try:
            recipe = project.recipe(address)
        except DxbError as error:
            wrong.append(error)
        else:
            yield {"recipe": address, "summary": recipe.summary if recipe else ""}


def _rules(project: Project) -> Iterator[Row]:
    for found in project.library.rules():
        yield {"rule": found.path, "summary": found.rule.summary}


def _backends(project: Project) -> Iterator[Row]:
    for found in project.library.rules():
        for backend in found.backends.values():
            facts, missing = backend.facts, backend.lacks(project.machine)
            yield {
                "rule": found.path,
                "backend": backend.name,
                "profiles": list(facts.profiles),
                "lacks": list(missing),
                "gpu_gb": facts.gpu_gb or None,
                "licence": facts.licence,
                "summary": facts.summary,
            }


def _backend_cells(row: Row) -> Row:
    return {
        "rule": row["rule"],
        "backend": row["backend"],
        "profiles": ",".join(row["profiles"]),
        "installed": "no: " + ", ".join(row["lacks"]) if row["lacks"] else "yes",
        "gpu": f"{row['gpu_gb']:g} GiB" if row["gpu_gb"] else "-",
        "licence": row["licence"],
        "summary": row["summary"],
    }


def _profiles(project: Project) -> Iterator[Row]:
    """The backends of every rule in every profile, in order of preference."""
    from dextera_build.recipe import profiles

    for name in profiles.names(project.root):
        profile = profiles.read(name, project.root, project.shown)
        for found in project.library.rules():
            if found.backends:
                listed, source = profile.preferred(found)
                yield {"profile": name, "rule": found.path, "backends": list(listed), "from": source}


def _profile_cells(row: Row) -> Row:
    return row | {"backends": ",".join(row["backends"]) or "-"}


def _divergent(project: Project) -> Iterator[Row]:
    """Keys whose node returned another output when it ran again."""
    from dextera_build.session import reading

    for found in reading(project).divergent.all():
        yield {
            "node": found.node,
            "key": found.key,
            "first": found.first,
            "again": list(found.again),
            "time": found.time,
        }


def _divergent_cells(row: Row) -> Row:
    short = {"key": row["key"][:12], "first": row["first"][:12], "again": ",".join(each[:12] for each in row["again"])}
    return _dated(row | short)


def _dated(row: Row) -> Row:
    """A row with the local date and time in place of seconds since the epoch."""
    return {
        name if name != "time" else "when": value if name != "time" else moment(value) for name, value in row.items()
    }

"""`dxb ls`: recipes, rules, backends, profiles, runs, recorded calls, nodes."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

from dextera_build.cli import nodes, options, table
from dextera_build.project.project import Project

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
    from dextera_build.explain.runs import runs

    project = options.project(args)
    listings = {
        "recipes": _recipes,
        "rules": _rules,
        "backends": _backends,
        "profiles": _profiles,
        "runs": runs,
        "divergent": _divergent,
    }
    if args.what == "calls":
        from dextera_build.explain import calls

        found = list(calls.rows(project))
        return table.give(found, as_json=args.json, cells=[calls.cells(row) for row in found])
    listing = listings.get(args.what)
    rows = list(listing(project) if listing else nodes.rows(project, args))
    return table.give(rows, as_json=args.json)


def _recipes(project: Project) -> Iterator[Row]:
    for address, _ in project.recipes():
        recipe = project.recipe(address)
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
                "profiles": ",".join(facts.profiles),
                "installed": "no: " + ", ".join(missing) if missing else "yes",
                "gpu": f"{facts.gpu_gb:g} GiB" if facts.gpu_gb else "-",
                "licence": facts.licence,
                "summary": facts.summary,
            }


def _profiles(project: Project) -> Iterator[Row]:
    """The backends of every rule in every profile, in order of preference."""
    from dextera_build.recipe import profiles

    for name in profiles.names(project.root):
        profile = profiles.read(name, project.root, project.shown)
        for found in project.library.rules():
            if found.backends:
                listed, source = profile.preferred(found)
                yield {"profile": name, "rule": found.path, "backends": ",".join(listed) or "-", "from": source}


def _divergent(project: Project) -> Iterator[Row]:
    """Keys whose node returned another output when it ran again."""
    import time

    from dextera_build.session import reading

    for found in reading(project).divergent.all():
        yield {
            "node": found.node,
            "key": found.key[:12],
            "first": found.first[:12],
            "again": ",".join(output[:12] for output in found.again),
            "when": time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(found.time)),
        }

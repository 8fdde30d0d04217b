"""`dxb report`: one offline HTML file of a run."""

from __future__ import annotations

import argparse
import os
import sys
import webbrowser
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from dextera_build.cli import options, table
from dextera_build.errors import DxbError, RecipeError

if TYPE_CHECKING:
    from dextera_build.recipe.expect import Expectation
    from dextera_build.session import Session


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument("run", nargs="?", metavar="RUN|RECIPE", help="a run's id, or a recipe for its last run")
    parser.add_argument("-o", "--out", metavar="FILE", help="where to write it (<cache>/out/<recipe>/report.html)")
    parser.add_argument("--against", metavar="RUN|RECIPE", help="a run to show beside it, picture by picture")
    parser.add_argument("--open", action="store_true", help="open it in the browser")
    options.project_arguments(parser)
    options.request_arguments(parser)
    options.json_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Write the file and print its path."""
    from dextera_build.building import places
    from dextera_build.explain import runs
    from dextera_build.report.build import build
    from dextera_build.report.view import placed
    from dextera_build.session import Session, reading

    project = options.project(args)
    events = runs.of_last_built(project, args.run, options.added(args))
    start = next(event for event in events if event["event"] == "run_started")
    recipe, variant = start["recipe"], start.get("variant", "")
    out = Path(args.out) if args.out else Path(places.of(project, recipe, variant).folder) / "report.html"
    licences = {
        f"{found.path}:{backend.name}": backend.facts.licence
        for found in project.library.rules()
        for backend in found.backends.values()
    }
    expected: Mapping[str, Expectation] = {}
    with suppress(RecipeError):  # a recipe that is wrong by now has no bounds
        found = project.recipe(recipe)
        expected = found.expect if found is not None else {}
    against = runs.find(project, args.against)[1] if args.against else None
    with table.writing(out, hint=None if args.out else f"dxb report {recipe} -o report.html"):
        view = placed(_page(Session(project, recipe, variant=variant), start["run"]), out)
        told = _told if sys.stderr.isatty() else None
        path = build(
            events, reading(project), out, licences=licences, expected=expected, view=view, against=against, told=told
        )
    if told is not None:
        print("\r\x1b[K", end="", file=sys.stderr)
    written = {"report": project.shown(path), "view": project.shown(out.with_name(view.link)) if view.link else None}
    table.say("report", written, project.shown(path), as_json=args.json)
    if args.open or (os.environ.get("DISPLAY") and os.isatty(1) and args.out is None):
        webbrowser.open(path.absolute().as_uri())
    return 0


def _told(done: int, count: int) -> None:
    print(f"\r{done:,} of {count:,} pictures\x1b[K", end="", file=sys.stderr, flush=True)


def _page(session: Session, run: str) -> str:
    """The page that shows the result in 3D.

    Returns:
        "" if the run is not the one that `dxb view` shows, made nothing to view, or viser is not installed.
    """
    from dextera_build.cli.look import shown
    from dextera_build.view import save, server

    if session.last_run() != run:
        return ""
    try:
        fill = shown.of(session, "")
        viewer, _ = server.start()
    except DxbError:
        return ""
    try:
        return save.page(viewer, fill(viewer))
    except DxbError:
        return ""
    finally:
        server.stop(viewer)

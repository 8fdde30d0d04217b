"""`dxb trace`: when every node of a run worked, for Perfetto, Chrome's about:tracing or speedscope."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from dextera_build.cli import options
from dextera_build.errors import UsageError


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument("run", nargs="?", metavar="RUN|RECIPE", help="a run's id, or a recipe for its last run")
    parser.add_argument("-o", "--out", metavar="FILE", help="where to write it (standard output)")
    options.project_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Print the trace, or write it and print its path."""
    from dextera_build.cli import runs
    from dextera_build.report import run as past
    from dextera_build.report.trace import trace
    from dextera_build.store.store import Store

    project = options.project(args)
    _, events = runs.find(project, args.run)
    text = json.dumps(trace(past.read(events, Store(project.cache))))
    if args.out is None:
        print(text)
        return 0
    path = Path(args.out)
    try:
        path.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise UsageError(f"`{path}` cannot be written: {error.strerror}", code="DXB-U177") from None
    print(project.shown(path.absolute()))
    return 0

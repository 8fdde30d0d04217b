"""`dxb show --trace`: when every node of a run worked, for Perfetto, Chrome's about:tracing or speedscope."""

from __future__ import annotations

import argparse
import json

from dextera_build.cli import options
from dextera_build.cli.look.output import give


def run(args: argparse.Namespace) -> int:
    """Print the trace, or write it and print its path."""
    from dextera_build.explain import runs
    from dextera_build.report import run as past
    from dextera_build.report.trace import trace
    from dextera_build.session import reading

    project = options.project(args)
    _, events = runs.find(project, args.target)
    return give(project, json.dumps(trace(past.read(events, reading(project)))), args.out)

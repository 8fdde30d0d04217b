"""How long commands take that do nothing."""

from __future__ import annotations

import sys
from collections.abc import Iterator

from tests.benchmarks.engine.extras.row import Bench, Row, of_cost


def start_up(bench: Bench) -> Iterator[Row]:
    """`--help` of every tool, beside a Python that does nothing."""
    commands = {"python": [sys.executable, "-c", "pass"]}
    commands |= {name: tool.start() for name, tool in bench.tools.items()}
    for name, command in commands.items():
        cost = bench.quickest(command, bench.work)
        what = "`python -c pass`" if name == "python" else f"start-up: `{command[-1]}`"
        yield of_cost(what, name, cost, cost.seconds * 1000, "ms", f"{cost.rss_mib:.0f} MiB")

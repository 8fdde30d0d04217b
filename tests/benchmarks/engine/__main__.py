"""dxb beside other build tools: `python -m tests.benchmarks.engine --help`, or `make bench-engine`."""

from __future__ import annotations

import argparse
import compileall
import json
import re
import shlex
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import dextera_build
from tests.benchmarks.engine import machine, page, table
from tests.benchmarks.engine.dags import SHAPES
from tests.benchmarks.engine.extras.all import EXTRAS
from tests.benchmarks.engine.extras.row import Bench, Row
from tests.benchmarks.engine.extras.startup import start_up
from tests.benchmarks.engine.phases import PHASES, Cell, Limits, course
from tests.benchmarks.engine.tools.all import TOOLS

PACKAGE = Path(dextera_build.__file__).parent
SIZES = (100, 1_000, 10_000, 100_000)


def main() -> int:
    """Measure, print the tables, write them to files; 1 where dxb failed or anything came out wrong."""
    args = _arguments()
    tools = {name: TOOLS[name] for name in args.tools}
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    cells: list[Cell] = []
    rows: list[Row] = []
    compileall.compile_dir(PACKAGE, quiet=2)  # as `pip install` does
    with tempfile.TemporaryDirectory(prefix="dxb-bench-", dir=args.work, ignore_cleanup_errors=True) as folder:
        work = Path(folder).resolve()
        facts, versions = machine.machine(work), machine.versions(tools)
        present = {name: tool for name, tool in tools.items() if versions[name]}
        for name in tools.keys() - present.keys():
            say(f"{name} is absent")
        bench = Bench(present, work, Limits(args.limit, args.repeats, args.budget), cells)
        ended = "broken off"
        try:
            _measure(args, bench, rows)
            ended = "ended"
        finally:  # what was measured before a fault or Ctrl-C is worth keeping
            facts |= {ended: time.strftime("%Y-%m-%d %H:%M"), f"load when {ended}": machine.load()}
            _write(args, facts, versions, cells, rows)
    return 1 if any(cell.state == "wrong" or (cell.state == "failed" and cell.tool == "dxb") for cell in cells) else 0


def _measure(args: argparse.Namespace, bench: Bench, rows: list[Row]) -> None:
    rows += start_up(bench)
    for cell in _cells(args, bench):
        shown = "" if cell.seconds is None else table.duration(cell.seconds)
        bench.cells.append(cell)
        say(f"{cell.shape} {cell.size} {cell.tool} {cell.phase}: {shown or cell.state} {cell.why}")
    for extra in EXTRAS if args.extra else ():
        for row in extra(bench):
            rows.append(row)
            shown = "-" if row.value is None else f"{table.number(row.value)} {row.unit}"
            say(f"{row.what} {row.tool}: {shown} {row.note}")


def _write(
    args: argparse.Namespace, facts: dict[str, str], versions: dict[str, str], cells: list[Cell], rows: list[Row]
) -> None:
    words = shlex.join(["python", "-m", "tests.benchmarks.engine", *sys.argv[1:]])
    command = re.sub(r" --(out|page|work)[ =]\S+", "", words)  # where results go says nothing of them
    if args.out:
        results = {"machine": facts, "versions": versions, "command": command}
        results |= {"cells": [cell.to_json() for cell in cells], "rows": [row.to_json() for row in rows]}
        args.out.parent.mkdir(parents=True, exist_ok=True)
        args.out.with_suffix(".json").write_text(json.dumps(results, indent=1) + "\n")
    parts = [
        table.header(facts, versions, {name: TOOLS[name] for name in args.tools}, command),
        table.cells(cells, args.limit, cpu=args.cpu),
        table.extras(rows),
    ]
    text = "\n\n".join(part.strip() for part in parts if part) + "\n"
    print(text, end="")
    if args.out:
        args.out.with_suffix(".md").write_text(text)
    if args.page:
        page.insert(args.page, text)


def _cells(args: argparse.Namespace, bench: Bench) -> Iterator[Cell]:
    """Graph by graph, so that the tools' figures for one graph are made close together."""
    over: set[tuple[str, str]] = set()
    for size in sorted(args.sizes):
        for shape in args.shapes:
            dag = SHAPES[shape](size)
            for name, tool in bench.tools.items():
                if (name, shape) in over:
                    yield from (Cell(name, shape, size, phase, "skipped") for phase in args.phases)
                    continue
                for cell in course(tool, dag, bench.work, bench.limits, args.phases):
                    if cell.state in ("slow", "failed"):
                        over.add((name, shape))
                    if cell.phase in args.phases:
                        yield cell


def say(text: str) -> None:
    """One line of progress."""
    print(text.rstrip(), file=sys.stderr, flush=True)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.engine", description=__doc__)
    parser.add_argument("--tools", type=_words(TOOLS), default=list(TOOLS), help=f"of {','.join(TOOLS)}")
    parser.add_argument("--shapes", type=_words(SHAPES), default=list(SHAPES), help=f"of {','.join(SHAPES)}")
    parser.add_argument("--phases", type=_words(PHASES), default=list(PHASES), help=f"of {','.join(PHASES)}")
    parser.add_argument("--sizes", type=_sizes, default=list(SIZES), help="numbers of nodes: 100,1000")
    parser.add_argument("--limit", type=float, default=120.0, help="seconds that one build may take")
    parser.add_argument("--repeats", type=int, default=5, help="builds of which a phase shows the quickest")
    parser.add_argument("--budget", type=float, default=10.0, help="seconds after which a phase is not repeated")
    parser.add_argument("--extra", action="store_true", help="restore, worker pool, memory, chain, large folder, twin")
    parser.add_argument("--cpu", action="store_true", help="show processor times, too: for a machine that is busy")
    parser.add_argument("--work", type=Path, help="where the projects are made; default: the temporary folder")
    parser.add_argument("--out", type=Path, metavar="STEM", help="write STEM.md and STEM.json")
    parser.add_argument("--page", type=Path, help="put the tables into this page, between its two `engine` marks")
    return parser.parse_args()


def _words(known: object) -> object:
    def parse(text: str) -> list[str]:
        words = text.split(",")
        for word in words:
            if word not in list(known):  # type: ignore[call-overload]
                raise argparse.ArgumentTypeError(f"`{word}` is not one of {', '.join(known)}")  # type: ignore[arg-type]
        return words

    return parse


def _sizes(text: str) -> list[int]:
    return [int(word.replace("_", "")) for word in text.split(",")]


if __name__ == "__main__":
    sys.exit(main())

"""Figures that are phases of some graph, said in another unit."""

from __future__ import annotations

from collections.abc import Iterator

from tests.benchmarks.engine.extras.row import Bench, Row
from tests.benchmarks.engine.phases import Cell

RESTORED, NODES, LONG = 1_000, 10_000, 100_000


def restore(bench: Bench) -> Iterator[Row]:
    """Outputs deleted, store kept; Ninja, which has no store, makes them anew."""
    for tool in bench.present("dxb", "bazel", "dvc", "ninja"):
        cell = bench.cell(tool, "wide", RESTORED, "deleted")
        yield _row(f"{RESTORED:,} deleted outputs back", cell, cell.seconds, "s")


def pool(bench: Bench) -> Iterator[Row]:
    """What a trivial node costs: through dxb's workers and store, and inside doit without either."""
    for tool in bench.present("dxb", "doit", "ninja"):
        cell = bench.cell(tool, "wide", NODES, "cold")
        each = None if cell.seconds is None else cell.seconds / NODES * 1000
        yield _row(f"one of {NODES:,} trivial nodes", cell, each, "ms", tool.step)


def long_chain(bench: Bench) -> Iterator[Row]:
    """A chain that no recursion survives."""
    for tool in bench.present("dxb", "ninja", "make", "doit"):
        cell = bench.cell(tool, "chain", LONG, "cold")
        yield _row(f"a chain of {LONG:,} nodes, cold", cell, cell.seconds, "s")


def memory(bench: Bench) -> Iterator[Row]:
    """The greatest memory of one process of a build of many nodes."""
    for tool in bench.present("dxb", "ninja", "make"):
        for phase in ("cold", "no-op", "leaf"):
            cell = bench.cell(tool, "layered", LONG, phase, "cold", "no-op", "leaf")
            yield _row(f"memory, {LONG:,} nodes, {phase}", cell, cell.rss_mib, "MiB")


def _row(what: str, cell: Cell, value: float | None, unit: str, note: str = "") -> Row:
    if cell.state in ("slow", "failed", "skipped"):
        value = None
    bad = "" if cell.state == "ok" else f"{cell.state}: {cell.why}".rstrip(": ")
    return Row(what, cell.tool, value, unit, bad or note)

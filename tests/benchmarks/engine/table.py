"""Results as Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from tests.benchmarks.engine.extras.row import Row
from tests.benchmarks.engine.phases import PHASES, Cell
from tests.benchmarks.engine.tools.tool import Tool

TITLES = {
    "cold": "cold",
    "no-op": "no-op",
    "leaf": "leaf changed",
    "back": "changed back",
    "comment": "comment changed",
    "touched": "touched",
    "deleted": "outputs deleted",
}

COUNTED = ("leaf", "comment", "touched", "deleted")


def header(machine: Mapping[str, str], versions: Mapping[str, str], tools: Mapping[str, Tool], command: str) -> str:
    """What the tables belong to."""
    facts = "; ".join(f"{name}: {value}" for name, value in machine.items())
    rows = [(name, versions[name], tool.step, tool.note or "-") for name, tool in tools.items() if versions[name]]
    absent = [name for name in tools if not versions[name]]
    lines = [f"`{command}`", "", facts + ".", "", *grid(("tool", "version", "a node is", "notes"), rows)]
    if absent:
        lines += ["", f"Absent, so left out: {', '.join(absent)}."]
    return "\n".join(lines)


def cells(found: Sequence[Cell], limit: float, *, cpu: bool = False) -> str:
    """One table for every graph, with processor times in brackets if `cpu`."""
    parts = []
    for shape, size in dict.fromkeys((cell.shape, cell.size) for cell in found):
        here = [cell for cell in found if (cell.shape, cell.size) == (shape, size)]
        phases = [phase for phase in PHASES if any(cell.phase == phase for cell in here)]
        rows = []
        for tool in dict.fromkeys(cell.tool for cell in here):
            of = {cell.phase: cell for cell in here if cell.tool == tool}
            rows.append((tool, *(_shown(of.get(phase), limit, cpu) for phase in phases), _memory(of), _ran(of, phases)))
        counted = " / ".join(TITLES[phase] for phase in phases if phase in COUNTED)
        titles = ("tool", *(TITLES[phase] for phase in phases), "memory [MiB]", f"nodes run, {counted}")
        parts += [f"### {shape}, {size:,} nodes", "", *grid(titles, rows), *notes(here), ""]
    return "\n".join(parts)


def notes(found: Sequence[Cell]) -> list[str]:
    """What went wrong, in words."""
    said = [f"* {c.tool}, {TITLES[c.phase]}: {c.why}" for c in found if c.state in ("failed", "wrong")]
    return ["", *said] if said else []


def extras(rows: Sequence[Row]) -> str:
    """The rows beside the graphs."""
    shown = [(row.what, row.tool, "-" if row.value is None else number(row.value), row.unit, row.note) for row in rows]
    return "\n".join(grid(("what", "tool", "value", "unit", "notes"), shown))


def grid(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """A Markdown table."""
    cells = [titles, ["---"] * len(titles), *rows]
    return ["| " + " | ".join(cell.replace("|", "\\|") or " " for cell in row) + " |" for row in cells]


def duration(seconds: float) -> str:
    """`84 ms`, `1.38 s`, `97 s`."""
    if seconds < 1:
        return f"{seconds * 1000:.0f} ms"
    return f"{seconds:.2f} s" if seconds < 10 else f"{seconds:.0f} s"


def number(value: float) -> str:
    """`0.29`, `63`, `4,237`."""
    return f"{value:,.0f}" if value >= 10 else f"{value:.2g}"


def _shown(cell: Cell | None, limit: float, cpu: bool) -> str:
    if cell is None:
        return "-"
    if cell.state == "slow":
        return f"> {limit:.0f} s"
    if cell.seconds is None:
        return "fails" if cell.state == "failed" else "-"
    used = f" ({duration(cell.cpu)})" if cpu and cell.cpu is not None else ""
    return duration(cell.seconds) + used + (" wrong" if cell.state == "wrong" else "")


def _memory(of: Mapping[str, Cell]) -> str:
    known = [cell.rss_mib for cell in of.values() if cell.rss_mib is not None]
    return f"{max(known):.0f}" if known else "-"


def _ran(of: Mapping[str, Cell], phases: Sequence[str]) -> str:
    counts = [of[phase].ran if phase in of else None for phase in phases if phase in COUNTED]
    return " / ".join("-" if count is None else str(count) for count in counts) or "-"

"""benchmark.gather: concatenate tables with the same columns."""

from __future__ import annotations

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.table import Column, Table
from dextera_build.rule import Context, rule


@rule(version=1)
def gather(ctx: Context, tables: Collection[Table]) -> Table:
    """Return all rows, prefixed with their table's label; the columns must match."""
    parts = list(tables.items.items())
    ctx.check(bool(parts), "no tables were given")
    _, first = parts[0]
    for label, table in parts:
        ctx.check(
            table.columns == first.columns,
            f"the columns of `{label}` differ from those of `{parts[0][0]}`",
            columns=", ".join(column.name for column in table.columns),
        )
    rows = tuple((label, *row) for label, table in parts for row in table.rows)
    notes = tuple(dict.fromkeys(note for _, table in parts for note in table.notes))
    ctx.say(f"{len(parts)} tables, {len(rows)} rows")
    return Table(title=first.title, columns=(Column(name="case"), *first.columns), rows=rows, notes=notes)

"""Tables of numbers for reports and papers."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import ClassVar

from dextera_build.artifacts import describe
from dextera_build.artifacts.base import Artifact, Value


class Column(Value):
    """One column."""

    name: str
    """Heading."""
    unit: str = ""
    """Unit, printed after the heading."""
    digits: int = 3
    """Digits after the decimal point."""
    better: str = ""
    """`higher`, `lower` or empty."""


Cell = str | float | int | bool | None


class Table(Artifact):
    """A table with typed columns; None is printed as a dash."""

    saves: ClassVar[tuple[str, ...]] = (".csv",)

    title: str
    """One line."""
    columns: tuple[Column, ...]
    """Headings."""
    rows: tuple[tuple[Cell, ...], ...]
    """Cells, one tuple per row, as long as `columns`."""
    notes: tuple[str, ...] = ()
    """Definitions, tolerances and counts that a reader needs to trust the numbers."""

    def text(self, value: Cell, column: Column) -> str:
        """One cell as text."""
        if value is None:
            return "-"
        return f"{value:.{column.digits}f}" if isinstance(value, float) else str(value)

    def _repr_html_(self) -> str:
        headings = [f"{column.name} [{column.unit}]" if column.unit else column.name for column in self.columns]
        rows = [[self.text(cell, column) for cell, column in zip(row, self.columns, strict=True)] for row in self.rows]
        return describe.page(repr(self), None, describe.table(headings, rows))

    def _write(self, path: Path) -> list[Path]:
        buffer = io.StringIO()
        writer = csv.writer(buffer, lineterminator="\n")
        writer.writerow([f"{c.name} [{c.unit}]" if c.unit else c.name for c in self.columns])
        writer.writerows(self.rows)
        path.write_text(buffer.getvalue())
        return [path]

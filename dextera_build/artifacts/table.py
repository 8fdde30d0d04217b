"""Tables of numbers for reports and papers."""

from __future__ import annotations

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

    @property
    def heading(self) -> str:
        """Name and unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


Cell = str | float | int | bool | None


class Table(Artifact):
    """A table with typed columns; None is printed as a dash."""

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

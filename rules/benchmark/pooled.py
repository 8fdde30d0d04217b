"""The rows of many tables of evaluate.objects as arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.table import Table
from dextera_build.errors import RuleError

from ..evaluate import objects

METRICS = tuple(column.name for column in objects.COLUMNS[3:])
"""Names of the measured columns."""


@dataclass(frozen=True)
class Pool:
    """All objects of some scenes."""

    scenes: int
    """Number of photographs with a twin."""
    true: int
    """Number of true objects that are expected to be found."""
    found: int
    """Number of those that were found."""
    spurious: int
    """Number of assets that match none."""
    metrics: dict[str, np.ndarray]
    """Column -> its numbers, (N,)."""

    @classmethod
    def of(cls, table: Table, expected: Table, scenes: frozenset[str] | None = None) -> Pool:
        """The rows of a gathered table, of some of its photographs or of all.

        Args:
            table: Table of `evaluate.objects`.
            expected: Table of `evaluate.visible`; all objects of photographs that are not in `table` were missed.
            scenes: Labels of photographs.

        Raises:
            RuleError: The table has other columns.
        """
        names = [column.name for column in table.columns]
        if names[1:] != [column.name for column in objects.COLUMNS]:
            raise RuleError(
                "the table does not hold the rows of `evaluate.objects`",
                facts={"columns": ", ".join(names)},
                hint="give the output of `benchmark.gather` over `evaluate.objects` with `summary: false`",
            )
        rows = [row for row in table.rows if scenes is None or row[0] in scenes]
        built = {row[0] for row in rows}
        lost = sum((scenes is None or row[0] in scenes) and row[0] not in built for row in expected.rows)
        true = [row for row in rows if row[1] != objects.SPURIOUS]
        columns = {name: [row[names.index(name)] for row in true] for name in METRICS}
        columns["Mask IoU"] += [0.0] * lost
        return cls(
            scenes=len(built),
            true=len(true) + lost,
            found=sum(row[2] != "missed" for row in true),
            spurious=len(rows) - len(true),
            metrics={
                name: np.array([cell for cell in cells if isinstance(cell, int | float)], np.float64)
                for name, cells in columns.items()
            },
        )

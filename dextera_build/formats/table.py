"""`Table` as CSV."""

from __future__ import annotations

import csv
import io
from pathlib import Path

from dextera_build.artifacts.table import Table


def save(table: Table, path: Path) -> list[Path]:
    """Write one row of headings, then the cells."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow([column.heading for column in table.columns])
    writer.writerows(table.rows)
    path.write_text(buffer.getvalue())
    return [path]

"""Opens PLY files with plyfile, in a process of its own: `plyfile_reader.py FOLDER OUT.npz`."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from plyfile import PlyData


def main(folder: str, out: str) -> None:
    """Write all columns of all elements, `FILE/element/column`, and the comments, `FILE/comments`."""
    found: dict[str, object] = {}
    for path in sorted(Path(folder).glob("*.ply")):
        read = PlyData.read(path)
        found[f"{path.name}/comments"] = list(read.comments)
        for element in read.elements:
            columns = {each.name: element[each.name] for each in element.properties}
            rows = {name: np.stack(column) if column.dtype == object else column for name, column in columns.items()}
            found |= {f"{path.name}/{element.name}/{name}": column for name, column in rows.items()}
    np.savez(out, **found)


main(*sys.argv[1:])

"""Recordings that `dxb view` writes for Rerun, as Rerun reads them."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any, TypeAlias

from tests import readers
from tests.e2e.space import Space

Columns: TypeAlias = dict[str, list[Any]]
"""Entity and column, `/task/box Transform3D:translation` -> its rows; of an entity alone, ` time`, the times [s]."""


def saved(space: Space, target: str, scratch: Path, *words: str) -> Columns:
    """Every column of a recording that Rerun reads."""
    path = readers.beside("rerun", scratch / "path", "rerun", "rerun_bindings", "rerun_cli")
    answer = space.run("view", target, *words, "--save", "seen.rrd", env={"PYTHONPATH": str(path)})
    assert answer.code == 0, answer.err
    assert " lacks " not in answer.err
    readers.run("rerun", Path(__file__).with_name("rrd_reader.py"), space.root / "seen.rrd", scratch / "found.pickle")
    found: Columns = pickle.loads((scratch / "found.pickle").read_bytes())
    return found

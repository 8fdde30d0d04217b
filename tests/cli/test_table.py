"""Rows on a terminal and in a pipe."""

from __future__ import annotations

import os
import sys

import pytest

from dextera_build.cli import table

ROWS = [
    {"node": "scene", "status": "stale", "last_seconds": "12.5", "backend": "-"},
    {"node": "body[mug].mesh", "status": "cached", "last_seconds": "3.0", "backend": "primitives"},
]


def test_a_pipe_gets_cells_between_tabs(capsys: pytest.CaptureFixture[str]) -> None:
    table.show(ROWS)
    assert capsys.readouterr().out == "scene\tstale\t12.5\t-\nbody[mug].mesh\tcached\t3.0\tprimitives\n"
    table.show([])
    assert capsys.readouterr().out == ""


def test_a_terminal_gets_aligned_columns_with_units(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True, raising=False)
    monkeypatch.setattr("shutil.get_terminal_size", lambda **_: os.terminal_size((100, 24)))
    monkeypatch.setenv("NO_COLOR", "1")
    table.show(ROWS)
    assert capsys.readouterr().out.splitlines() == [
        "node            status  last run [s]  backend",
        "scene           stale           12.5  -",
        "body[mug].mesh  cached           3.0  primitives",
    ]
    monkeypatch.setattr("shutil.get_terminal_size", lambda **_: os.terminal_size((31, 24)))
    table.show(ROWS)
    assert capsys.readouterr().out.splitlines()[2] == "body[mug].mesh  cached       …"

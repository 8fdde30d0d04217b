"""Rows on a terminal and in a pipe."""

from __future__ import annotations

import os
import sys

import pytest

from dextera_build.cli import table
from dextera_build.cli.main import main

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
    assert capsys.readouterr().out.splitlines() == [
        "node            status",
        "scene           stale",
        "    last run [s]: 12.5",
        "body[mug].mesh  cached",
        "    last run [s]: 3.0;",
        "    backend: primitives",
    ]


@pytest.mark.parametrize("columns", [80, 100])
def test_nothing_of_a_rule_is_cut_at_80_columns(
    columns: int, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True, raising=False)
    monkeypatch.setattr("shutil.get_terminal_size", lambda **_: os.terminal_size((columns, 24)))
    monkeypatch.setenv("NO_COLOR", "1")
    assert main(["help", "factorize.mesh"]) == 0
    out = capsys.readouterr().out
    assert max(map(len, out.splitlines())) < columns
    assert "…" not in out
    head, *lines = out.splitlines()
    at = next(number for number, line in enumerate(lines) if line.startswith("primitives.wall_m"))
    end = next(number for number, line in enumerate(lines) if number > at and not line.startswith(" "))
    value, meaning = head.index("value"), head.index("meaning")
    assert [line[value:meaning].strip() for line in lines[at:end]] == ["float", "= 0.003 m", "> 0, <= 0.3"]
    told = " ".join(line[meaning:].strip() for line in lines[at:end]).strip()
    assert told == "Wall thickness of a vessel if the view does not show it [m]."


@pytest.mark.medium
def test_a_table_of_many_columns_puts_the_last_ones_below(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True, raising=False)
    monkeypatch.setattr("shutil.get_terminal_size", lambda **_: os.terminal_size((80, 24)))
    monkeypatch.setenv("NO_COLOR", "1")
    assert main(["ls", "backends"]) == 0
    out = capsys.readouterr().out
    assert max(map(len, out.splitlines())) < 80
    assert "…" not in out
    assert out.startswith("rule ")
    assert "fitted to the view" in " ".join(out.split())

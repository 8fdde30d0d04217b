"""A toy bus whose wheels nobody sees stands free in its twin, and the scripted operator lifts it."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from tests.e2e.space import Space
from tests.recipes.test_captured_tables import assert_rests, built

ATTEMPTS = 3
"""Attempts of the operator, of which the recipe makes fifty."""


@pytest.mark.slow
def test_a_toy_bus_stands_free_and_is_lifted(tmp_path: Path) -> None:
    space = Space(tmp_path)
    assert_rests(built(space, "twin/bus_table:scene")["scene"], held=0)
    report = json.loads(built(space, "twin/bus_table:settle")["settle"].read_text())
    assert {body["name"] for body in report["bodies"]} == {"toy_bus", "blue_mug", "basket"}
    shown = built(space, "task/ob/lift_toy_bus:expert", "--set", f"attempts.attempts={ATTEMPTS}")
    (row,) = csv.DictReader(shown["expert"].read_text().splitlines())
    assert (row["task"], row["attempts"], row["success [%]"]) == ("LiftToyBus", str(ATTEMPTS), "100.0")

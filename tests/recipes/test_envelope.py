"""The envelope of docs/benchmarks/drawn_scenes.md, on a few drawn scenes; `make meshes` fetches their meshes."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
import yaml

from tests.e2e.space import Space

REPO = Path(__file__).parents[2]
MESHES = REPO / ".venv/objects"
NAMES = (
    *("alphabet_soup", "apple", "black_book", "black_bowl", "cereal", "cookies", "cubemedium", "cup"),
    *("macaroni_and_cheese", "milk_carton", "salad_dressing", "scanned_apple", "scanned_wood_block", "tomato_sauce"),
    *("toothpaste", "wine_bottle"),
)
"""Things that take little time to cut into convex pieces."""
FOUND, IOU = 90.0, 0.85
"""Least share of objects found [%], and least mean mask IoU, in the middle of the envelope."""


def write_small_library(space: Space) -> None:
    """Recipe `small/objects`: `benchmark/objects` with `NAMES` alone."""
    recipe = yaml.safe_load((REPO / "recipes/benchmark/objects.yaml").read_text())
    entries = recipe["nodes"]["read"]["entries"]
    recipe["nodes"]["read"]["entries"] = {name: entries[name] for name in NAMES}
    space.write("recipes/small/objects.yaml", yaml.safe_dump(recipe))


@pytest.mark.slow
@pytest.mark.skipif(not (MESHES / ".fetched").exists(), reason="no meshes: `make meshes`")
def test_the_bound_holds_in_the_middle_of_the_envelope(tmp_path: Path) -> None:
    space = Space(tmp_path)
    write_small_library(space)
    envelope = {
        "summary": "The middle of the envelope.",
        "extends": "benchmark/envelope",
        "nodes": {"library": {"recipe": "small/objects", "meshes": "$meshes"}},
    }
    space.write("recipes/small/envelope.yaml", yaml.safe_dump(envelope))
    sweep = '{"distance_m": [0.8], "width_px": [1280]}'
    answer = space.build(
        "small/envelope", "--input", f"meshes={MESHES}", "--set", f"draws.sweep={sweep}", "--set", "draws.scenes=2"
    )
    assert answer.code == 0, answer.err[-3000:]
    placed = dict(line.split("\t") for line in answer.out.splitlines())
    rows = list(csv.DictReader((tmp_path / placed["curves"]).read_text().splitlines()))
    assert len(rows) == 2
    for row in rows:
        assert float(row["Built [%]"]) == 100.0, row
        assert int(row["True"]) >= 6, row
        assert float(row["Found [%]"]) >= FOUND, row
        assert float(row["Mask IoU"]) >= IOU, row

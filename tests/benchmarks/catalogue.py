"""The foreign meshes that `make meshes` fetches: entries of `reference.catalogue`, by name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

REPO = Path(__file__).parents[2]
FOLDER = REPO / ".venv" / "objects"
"""What `make meshes` wrote."""
REPORTED, LEARNED = "objects", "objects_learn"
"""Recipes of `benchmark` with the two halves: what is learned or chosen on the second is reported on the first."""


def entries(*recipes: str) -> dict[str, dict[str, Any]]:
    """Name -> entry of the meshes of these recipes; of both halves by default."""
    found: dict[str, dict[str, Any]] = {}
    for recipe in recipes or (REPORTED, LEARNED):
        text = (REPO / "recipes" / "benchmark" / f"{recipe}.yaml").read_text()
        found |= yaml.safe_load(text)["nodes"]["read"]["entries"]
    return dict(sorted(found.items()))

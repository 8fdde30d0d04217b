"""`Pose` and `Similarity` as JSON."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from dextera_build.artifacts.spatial.pose import Pose, Similarity


def export(motion: Pose | Similarity, folder: Path, stem: str) -> list[Path]:
    """Write `stem.json`, the matrix row by row."""
    fields = {name: getattr(motion, name) for name in type(motion).model_fields}
    plain = {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in fields.items()}
    path = folder / f"{stem}.json"
    path.write_text(json.dumps(plain, indent=1) + "\n")
    return [path]

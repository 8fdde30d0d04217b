"""Values without a file format: every part that is an artifact in its own files, the rest as JSON and NPZ."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from dextera_build.artifacts.base import Artifact
from dextera_build.artifacts.core.arrays import is_array


def export(whole: Artifact, folder: Path, stem: str) -> list[Path]:
    """Write the fields of a value to `folder`; the first path is the main file."""
    arrays: dict[str, Any] = {}
    plain: dict[str, Any] = {}
    written: list[Path] = []
    for name in type(whole).model_fields:
        value = getattr(whole, name)
        if is_array(value):
            arrays[name] = value
        elif isinstance(value, Artifact):
            written += value.export(folder, f"{stem}.{name}")
        elif (parts := _parts(value)) and all(isinstance(part, Artifact) for part in parts.values()):
            for label, part in parts.items():
                written += part.export(folder, f"{stem}.{name}.{label}")
        elif parts and all(map(is_array, parts.values())):
            arrays |= {f"{name}.{label}": part for label, part in parts.items()}
        else:
            plain[name] = value.model_dump(mode="json") if isinstance(value, BaseModel) else value
    if arrays:
        path = folder / f"{stem}.npz"
        np.savez(path, **arrays)
        written.append(path)
    if plain:
        path = folder / f"{stem}.json"
        path.write_text(json.dumps(plain, indent=1, sort_keys=True, default=_plain) + "\n")
        written.insert(0, path)
    return written


def _parts(value: Any) -> dict[str, Any]:
    """Label or index -> part of a dict or a sequence."""
    if isinstance(value, tuple):
        return {str(index): part for index, part in enumerate(value)}
    return value if isinstance(value, dict) else {}


def _plain(value: Any) -> Any:
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json")
    if isinstance(value, Artifact | bytes):
        return f"<{type(value).__name__}>"
    return str(value)

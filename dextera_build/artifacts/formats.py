"""File formats of artifact types, selected by the suffix of the file."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from dextera_build.errors import ArtifactError

_FRAME = "frame "


def module(name: str) -> Any:
    """The module `artifacts.NAME`, which writes files with a heavy package.

    It is loaded by name because exports are not part of results, so that neither its code nor its packages enter the
    keys of all rules that use the type. A rule that reads files through such a module imports it.
    """
    return importlib.import_module(f"dextera_build.artifacts.{name}")


def frame_comments(frame: str) -> tuple[str, ...]:
    """Comments of a file that name the frame of its coordinates."""
    return (f"{_FRAME}{frame}",) if frame else ()


def frame_of(comments: Sequence[str]) -> str:
    """The frame that comments of a file name, or ""."""
    return next((line.removeprefix(_FRAME) for line in comments if line.startswith(_FRAME)), "")


def suffix_among(kind: str, path: Path, known: Sequence[str]) -> str:
    """The suffix of `path` in lower case.

    Args:
        kind: Name of the artifact type.
        path: The file.
        known: The type's suffixes for this direction, `.ply`.

    Raises:
        ArtifactError: It is none of them.
    """
    suffix = path.suffix.lower()
    if suffix in known:
        return suffix
    raise ArtifactError(
        f"`{path.name}` names no file format of a {kind}",
        code="DXB-A401",
        facts={"formats": " ".join(known) or "none"},
        hint=f"name the file `{path.stem}{known[0]}`" if known else None,
    )


def unreadable(path: str | Path, form: str, why: object) -> ArtifactError:
    """The error for a file whose content is not of the format `form`.

    Args:
        path: The file.
        form: Name of the format: `PLY`.
        why: The fault.
    """
    return ArtifactError(
        f"`{Path(path).name}` cannot be read as {form}",
        code="DXB-A402",
        facts={"why": why},
        hint="export the file again, or convert it with the program that wrote it",
    )


def unwritable(kind: str, form: str, why: object) -> ArtifactError:
    """The error for a value that the format `form` cannot represent.

    Args:
        kind: Name of the artifact type.
        form: Name of the format: `TUM`.
        why: The fields that it cannot hold.
    """
    return ArtifactError(
        f"this {kind} cannot be written as {form}",
        code="DXB-A507",
        facts={"why": why},
        hint="choose another format by the suffix, or leave out the fields that it cannot hold",
    )

"""File formats of artifact types, told apart by the suffix of the file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from dextera_build.errors import ArtifactError


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
        why: What is wrong with it.
    """
    return ArtifactError(
        f"`{Path(path).name}` cannot be read as {form}",
        code="DXB-A402",
        facts={"why": why},
        hint="export the file again, or convert it with the program that wrote it",
    )

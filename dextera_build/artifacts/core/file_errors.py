"""The error for files and values that hold damaged data of a format."""

from __future__ import annotations

from pathlib import Path

from dextera_build.errors import ArtifactError


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

"""Parts of many formats: the suffix of a file, comments that name a frame, the error for a value without a form."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from dextera_build.errors import ArtifactError

_FRAME = "frame "


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
    if suffix not in known:
        raise no_format(kind, path, known)
    return suffix


def no_format(kind: str, path: Path, known: Sequence[str]) -> ArtifactError:
    """The error for a suffix that is none of `known`; arguments as for `suffix_among`."""
    return ArtifactError(
        f"`{path.name}` names no file format of a {kind}",
        code="DXB-A401",
        facts={"formats": " ".join(known) or "none"},
        hint=f"name the file `{path.stem}{known[0]}`" if known else None,
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

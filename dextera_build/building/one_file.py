"""An artifact as one file, in the format of the file's suffix."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from dextera_build.artifacts.base import Artifact, File, Folder
from dextera_build.errors import UsageError, listing
from dextera_build.formats import stage_files
from dextera_build.formats.registry import suffixes


def write(artifact: Artifact, path: Path, told: Callable[[str], None] = lambda text: None) -> list[Path]:
    """Write an artifact, or its one part that has a format with this suffix, as `path`; returns all files.

    Args:
        artifact: The artifact.
        path: The file.
        told: Takes the line that says which part was written.

    Raises:
        UsageError: No part, or more than one, can be written in this form.
    """
    if isinstance(artifact, File):  # holds bytes, which have the format that they have
        return artifact.export(path.parent, path.name)
    suffix, level = path.suffix.lower(), [artifact]
    if isinstance(artifact, Folder) and suffix == ".usdz" and (stages := _stages(artifact)):
        return _package(artifact, stages[0], path)
    forms: dict[str, None] = {}
    while level:
        found = [part for part in level if suffix in suffixes(type(part))]
        if len(found) == 1:
            if found[0] is not artifact:
                told(f"`{path}` is the {found[0].name()} in {artifact.name()}, and nothing else of it")
            return found[0].save(path)
        if found:
            raise _refused(artifact, path, forms, f"it holds {len(found)} parts of that form")
        forms |= dict.fromkeys(form for part in level for form in suffixes(type(part)) if _holders(level, form) == 1)
        # A part of a type with its own format, such as a mesh's texture, is in that file.
        level = [part for whole in level if not suffixes(type(whole)) for part in _parts(whole)]
    raise _refused(artifact, path, forms, "neither it nor a part of it has that form")


def _stages(folder: Folder) -> list[str]:
    """The topmost USD stages of a folder."""
    return sorted(name for name in folder.files if "/" not in name and name.endswith((".usda", ".usdc", ".usd")))


def _package(folder: Folder, stage: str, path: Path) -> list[Path]:
    """Write a stage of a folder with everything that it names as one file."""
    with tempfile.TemporaryDirectory() as scratch:
        folder.export(scratch, path.stem)
        path.parent.mkdir(parents=True, exist_ok=True)
        return stage_files.package(path, Path(scratch, stage))


def _holders(level: Iterable[Artifact], form: str) -> int:
    return sum(form in suffixes(type(part)) for part in level)


def _parts(whole: Artifact) -> Iterator[Artifact]:
    """The artifacts in the fields of an artifact."""
    for name in type(whole).model_fields:
        value = getattr(whole, name)
        within = value.values() if isinstance(value, dict) else value if isinstance(value, tuple) else (value,)
        yield from (part for part in within if isinstance(part, Artifact))


def _refused(artifact: Artifact, path: Path, forms: Iterable[str], why: str) -> UsageError:
    return UsageError(
        f"{artifact.name()} cannot be written as `{path.name}`: {why}",
        code="DXB-U220",
        facts={"one file": listing(forms)} if forms else None,
        hint=f"`-o {path.with_suffix('')}/` writes a folder with all of its files",
    )

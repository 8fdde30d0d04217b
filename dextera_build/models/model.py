"""A pretrained model as its description states it, and the files of one version of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from dextera_build import digest
from dextera_build.errors import Place


@dataclass(frozen=True)
class Model:
    """The description of a model in `recipes/model/NAME.yaml`."""

    name: str
    """`grounding_dino`."""
    summary: str
    source: str
    """`hf:OWNER/NAME@REVISION`, `https://...`, `package:DISTRIBUTION/PATH`; "" if a user has to bring the files."""
    licence: str
    """SPDX identifier, or the name that its authors gave it."""
    files: tuple[str, ...] = ("*",)
    """Patterns of the files to take from a repository."""
    digest: str = ""
    """Digest of the only version to use; "" accepts the installed one."""
    forbids: str = ""
    """Uses that the licence forbids: `commercial use`; they must be accepted once."""
    gated: str = ""
    """Why a download needs a token; "" if it needs none."""
    memory_gb: float = 0.0
    """Memory that the loaded model takes [GiB]."""
    rows: str = ""
    """The part of the pipeline that it fills."""
    place: Place = field(default_factory=lambda: Place(""))


class ModelFile(NamedTuple):
    """One file of a model."""

    path: str
    """Relative to the model's folder."""
    size: int
    """[bytes]"""
    sha256: str


@dataclass(frozen=True)
class Installed:
    """One version of a model on this machine."""

    name: str
    digest: str
    """Of the list of files; see `digest_of`."""
    folder: Path
    files: tuple[ModelFile, ...]
    source: str
    """Where the files came from."""

    @property
    def size(self) -> int:
        """Size of all files [bytes]."""
        return sum(file.size for file in self.files)


def digest_of(files: tuple[ModelFile, ...]) -> str:
    """Digest of a model: SHA-256 of the canonical JSON of `[[path, size, sha256], ...]`, sorted by path."""
    return digest.of_bytes(digest.canonical([list(file) for file in sorted(files)]))

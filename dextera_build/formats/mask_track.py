"""`MaskTrack` as a ZIP archive of indexed PNGs with `meta.json`."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from dextera_build.artifacts.cameras.mask_track import DAMAGE, FORM, MaskTrack, indices, member
from dextera_build.artifacts.core.file_errors import unreadable
from dextera_build.artifacts.packed import DAY
from dextera_build.formats.files import suffix_among

_META = "meta.json"
_MOST_BYTES = 1 << 26
"""Largest PNG of one frame."""


def save(track: MaskTrack, path: Path) -> list[Path]:
    """The archive, with names, times and scores in `meta.json`."""
    said: dict[str, Any] = {"names": list(track.names), "stamps_s": track.stamps.tolist(), "first": track.first}
    if track.scores is not None:
        said["scores"] = track.scores.tolist()
    with track.file.open() as raw, zipfile.ZipFile(raw) as archive, zipfile.ZipFile(path, "w") as target:
        for number in range(len(track.stamps)):
            target.writestr(zipfile.ZipInfo(member(number), DAY), archive.read(member(number)))
        target.writestr(zipfile.ZipInfo(_META, DAY), json.dumps(said) + "\n", zipfile.ZIP_DEFLATED)
    return [path]


def load(path: str | Path, stamps: np.ndarray | None = None) -> MaskTrack:
    """Read an archive written by `save`, or another one of indexed PNGs whose names are sorted by time.

    Args:
        path: The `.zip` file.
        stamps: Time of each frame [s], for an archive without `meta.json`; its objects are named `1`, `2`, ...

    Raises:
        ArtifactError: It is no such archive.
    """
    suffix_among("MaskTrack", Path(path), (".zip",))
    try:
        with zipfile.ZipFile(path) as archive:
            return _of_archive(archive, stamps)
    except DAMAGE as error:
        raise unreadable(path, FORM, error) from None


def _of_archive(archive: zipfile.ZipFile, stamps: np.ndarray | None) -> MaskTrack:
    members = sorted((n for n in archive.namelist() if n.lower().endswith(".png")), key=lambda n: (len(n), n))
    if not members or any(each.file_size > _MOST_BYTES for each in archive.infolist()):
        raise ValueError("it holds no PNG" if not members else "a file in it is larger than 64 MiB")
    said = json.loads(archive.read(_META)) if _META in archive.namelist() else {}
    if "stamps_s" not in said and stamps is None:
        raise ValueError(f"it has no `{_META}`, so the times of its frames must be given")
    times = np.array(said["stamps_s"] if stamps is None else stamps, np.float64)
    if times.shape != (len(members),):
        raise ValueError(f"it holds {len(members)} frames, and {times.size} times")

    def frames() -> Iterator[np.ndarray]:
        return (indices(archive.read(name)) for name in members)

    names = said.get("names") or range(1, max(int(labels.max(initial=0)) for labels in frames()) + 1)
    scores = said.get("scores") or [None] * len(members)
    return MaskTrack.of(list(map(str, names)), times, zip(frames(), scores, strict=True), said.get("first"))

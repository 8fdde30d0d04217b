"""`Trajectory` as the text format of the TUM RGB-D benchmark."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from dextera_build.artifacts.core.file_errors import unreadable
from dextera_build.artifacts.spatial.trajectory import Trajectory
from dextera_build.formats import stamped_rows
from dextera_build.formats.files import suffix_among

_FRAMES, _COVARIANCE = "# frames ", "# covariance "
"""Comments, which other programs skip: the two frames; the upper triangle of the next pose's covariance."""


def tum(path: Trajectory) -> str:
    """TUM text: `stamp x y z qx qy qz qw` per line; frames and covariances are comments."""
    lines = [f"{_FRAMES}{path.parent} {path.child}", "# timestamp tx ty tz qx qy qz qw"]
    for index, (stamp, pose) in enumerate(zip(path.stamps, path.poses, strict=True)):
        if path.covariances is not None:
            lines.append(_COVARIANCE + _words(path.covariances[index][stamped_rows.UPPER]))
        lines.append(_words(np.concatenate([[stamp], pose[:3], pose[4:], pose[3:4]])))
    return "\n".join(lines) + "\n"


def save(made: Trajectory, path: Path) -> list[Path]:
    """Write TUM text."""
    path.write_text(tum(made))
    return [path]


def load(path: str | Path, *, parent: str | None = None, child: str | None = None) -> Trajectory:
    """Read a TUM file.

    Args:
        path: The file.
        parent: Frame that the poses are in; None: as stated in a comment, otherwise `world`.
        child: Moving frame; None: as stated in a comment, otherwise `camera`.

    Raises:
        ArtifactError: It is no TUM file, or its stamps do not increase.
    """
    suffix_among("Trajectory", Path(path), (".txt",))
    return parse(Path(path).read_bytes(), path, parent=parent, child=child)


def parse(data: bytes, path: str | Path, *, parent: str | None = None, child: str | None = None) -> Trajectory:
    """The trajectory in the content of a TUM file that is named `path`; see `load`."""
    try:
        frames, rows, spread = _read(data.decode())
        placed = stamped_rows.unit(rows[:, [1, 2, 3, 7, 4, 5, 6]])
    except ValueError as error:
        raise unreadable(path, "TUM", error) from None
    return Trajectory(
        parent=parent or frames[0],
        child=child or frames[1],
        stamps=rows[:, 0].copy(),
        poses=placed,
        covariances=spread,
    )


def _words(numbers: np.ndarray) -> str:
    return " ".join(map(repr, numbers.tolist()))


def _read(text: str) -> tuple[tuple[str, str], np.ndarray, np.ndarray | None]:
    """Frames, rows (N, 8) and covariances (N, 6, 6) of a TUM file."""
    frames, rows, spread = ("world", "camera"), [], []
    for number, line in enumerate(text.splitlines(), 1):
        if line.startswith(_FRAMES) and len(line.split()) == 4:
            frames = (line.split()[2], line.split()[3])
        elif line.startswith(_COVARIANCE):
            spread.append(_numbers(line.removeprefix(_COVARIANCE), number, 21))
        elif line.strip() and not line.lstrip().startswith("#"):
            rows.append(_numbers(line.replace(",", " "), number, 8))
    if not rows:
        raise ValueError("it holds no pose")
    if spread and len(spread) != len(rows):
        raise ValueError(f"it holds {len(spread)} covariances for {len(rows)} poses")
    return frames, np.array(rows), stamped_rows.full(np.array(spread)) if spread else None


def _numbers(text: str, line: int, count: int) -> list[float]:
    try:
        found = [float(word) for word in text.split()]
    except ValueError:
        raise ValueError(f"line {line} holds a word that is no number") from None
    if len(found) != count or not all(map(math.isfinite, found)):
        raise ValueError(f"line {line} holds {len(found)} numbers where {count} finite ones are needed")
    return found

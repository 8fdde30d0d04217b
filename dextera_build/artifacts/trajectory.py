"""The trajectory of a frame in another one, with the text format of the TUM RGB-D benchmark."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from dextera_build.artifacts import stamped
from dextera_build.artifacts.base import Array, Artifact
from dextera_build.artifacts.formats import suffix_among, unreadable
from dextera_build.artifacts.image import png
from dextera_build.artifacts.pose import Pose
from dextera_build.errors import ArtifactError
from dextera_build.geometry import poses
from dextera_build.geometry.plot import COLOURS, Line, plot

_FRAMES, _COVARIANCE = "# frames ", "# covariance "
"""Comments, which other programs skip: the two frames; the upper triangle of the next pose's covariance."""


class Trajectory(Artifact):
    """Poses of one frame in another at increasing times."""

    saves: ClassVar[tuple[str, ...]] = (".txt",)

    parent: str = Field(pattern=r"^\S+$")
    """Frame that the poses are in."""
    child: str = Field(pattern=r"^\S+$")
    """Moving frame."""
    stamps: Annotated[np.ndarray, Array("N", "float64", unit="s")]
    """Times, increasing."""
    poses: Annotated[np.ndarray, Array("N 7", "float64", unit="m", frame="parent")]
    """T_parent_child: position, and unit quaternion w x y z."""
    covariances: Annotated[np.ndarray, Array("N 6 6", "float64", frame="parent")] | None = None
    """Covariance of translation [m] and rotation vector [rad], see `geometry.uncertainty`; None: exact, or not
    stated."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not len(self.stamps):
            raise ArtifactError("a Trajectory needs a pose", code="DXB-A503")
        stamped.check(self.name(), self.stamps, self.poses, self.covariances)
        return self

    def at(self, stamp: float) -> Pose:
        """The pose at a time [s]: linear in position, slerp in rotation, linear in covariance.

        Raises:
            ArtifactError: The time is outside the trajectory.
        """
        first, last = float(self.stamps[0]), float(self.stamps[-1])
        if not first <= stamp <= last:
            raise ArtifactError(
                f"the trajectory of `{self.child}` does not cover {stamp} s",
                code="DXB-A504",
                facts={"from": f"{first} s", "to": f"{last} s"},
                hint="ask for a time within it; both clocks must be the same",
            )
        after = min(int(np.searchsorted(self.stamps, stamp)), len(self.stamps) - 1)
        before = max(after - 1, 0)
        gap = float(self.stamps[after] - self.stamps[before])
        share = (stamp - float(self.stamps[before])) / gap if gap else 1.0
        pose = stamped.between(self.poses[before], self.poses[after], share)
        spread = self.covariances
        covariance = None if spread is None else (1 - share) * spread[before] + share * spread[after]
        return Pose(
            parent=self.parent, child=self.child, matrix=poses.to_matrix(pose), covariance=covariance, stamp=stamp
        )

    def length_m(self) -> float:
        """Length of the path [m]."""
        return float(np.linalg.norm(np.diff(self.poses[:, :3], axis=0), axis=1).sum())

    def facts(self) -> Iterator[str]:
        """Frames, number of poses, duration and length."""
        yield f"T_{self.parent}_{self.child}"
        yield f"{len(self.stamps):,} poses"
        yield f"{self.stamps[-1] - self.stamps[0]:.2f} s"
        yield f"{self.length_m():.3f} m"

    def picture(self) -> bytes:
        """The path from above; its first pose is the green dot, its last the orange one."""
        path = self.poses[:, :2]
        ends = [Line(path[:1], COLOURS[2], dots=True), Line(path[-1:], COLOURS[1], dots=True)]
        return png(plot([Line(path), *ends], "x [m]", "y [m]", equal=True))

    def tum(self) -> str:
        """TUM text: `stamp x y z qx qy qz qw` per line; frames and covariances are comments."""
        lines = [f"{_FRAMES}{self.parent} {self.child}", "# timestamp tx ty tz qx qy qz qw"]
        for index, (stamp, pose) in enumerate(zip(self.stamps, self.poses, strict=True)):
            if self.covariances is not None:
                lines.append(_COVARIANCE + _words(self.covariances[index][stamped.UPPER]))
            lines.append(_words(np.concatenate([[stamp], pose[:3], pose[4:], pose[3:4]])))
        return "\n".join(lines) + "\n"

    def _write(self, path: Path) -> list[Path]:
        path.write_text(self.tum())
        return [path]

    @classmethod
    def load(cls, path: str | Path, *, parent: str | None = None, child: str | None = None) -> Trajectory:
        """Read a TUM file.

        Args:
            path: The file.
            parent: Frame that the poses are in; None: as stated in a comment, otherwise `world`.
            child: Moving frame; None: as stated in a comment, otherwise `camera`.

        Raises:
            ArtifactError: It is no TUM file, or its stamps do not increase.
        """
        suffix_among(cls.name(), Path(path), cls.saves)
        return cls.parse(Path(path).read_bytes(), path, parent=parent, child=child)

    @classmethod
    def parse(cls, data: bytes, path: str | Path, *, parent: str | None = None, child: str | None = None) -> Trajectory:
        """The trajectory in the content of a TUM file that is named `path`; see `load`."""
        try:
            frames, rows, spread = _read(data.decode())
            placed = stamped.unit(rows[:, [1, 2, 3, 7, 4, 5, 6]])
        except ValueError as error:
            raise unreadable(path, "TUM", error) from None
        return cls(
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
    return frames, np.array(rows), stamped.full(np.array(spread)) if spread else None


def _numbers(text: str, line: int, count: int) -> list[float]:
    try:
        found = [float(word) for word in text.split()]
    except ValueError:
        raise ValueError(f"line {line} holds a word that is no number") from None
    if len(found) != count or not all(map(math.isfinite, found)):
        raise ValueError(f"line {line} holds {len(found)} numbers where {count} finite ones are needed")
    return found

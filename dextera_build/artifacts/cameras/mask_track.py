"""Masks of objects over time, with a ZIP archive of indexed PNGs as file format."""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from typing import Annotated, Self

import numpy as np
from pydantic import Field, NonNegativeInt, PositiveInt, model_validator

from dextera_build.artifacts.base import Array, Artifact, File
from dextera_build.artifacts.core.file_errors import unreadable
from dextera_build.artifacts.packed import DAY
from dextera_build.errors import ArtifactError

FORM = "ZIP of a mask track"
DAMAGE = (
    *(OSError, ValueError, KeyError, TypeError, EOFError, RuntimeError, SyntaxError),
    *(zlib.error, zipfile.BadZipFile),
)
"""Exceptions for damaged archives and pictures."""
_Frame = tuple[np.ndarray, np.ndarray | None]


class MaskTrack(Artifact):
    """The mask of each object in each frame of a video ("masklets" of video object segmentation).

    An object that is not visible in a frame, because it is hidden, outside the picture or lost, has an empty mask
    there.
    """

    file: File
    """ZIP archive of `00000.png`, `00001.png`, ..., one indexed PNG per frame as in DAVIS: index 0 is background,
    index k is the k-th object. Frames are decoded on access."""
    names: tuple[str, ...] = Field(min_length=1, max_length=255)
    """Name of object 1, 2, ..."""
    width: PositiveInt
    """Width of a frame [px]."""
    height: PositiveInt
    """Height of a frame [px]."""
    stamps: Annotated[np.ndarray, Array("N", "float64", unit="s")]
    """Time of each frame, as in the video."""
    areas: Annotated[np.ndarray, Array("N K", "int32", unit="px")]
    """Pixels of each object in each frame; 0 where it is not visible."""
    scores: Annotated[np.ndarray, Array("N K", "float32")] | None = None
    """Confidence of the method that the object is visible, 0..1; None if it has none."""
    first: NonNegativeInt | None = None
    """Number of the frame whose masks were given, from which the others follow; None if unknown."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        wrong = ""
        if self.areas.shape != (len(self.stamps), len(self.names)) or not len(self.stamps):
            shape = f"{len(self.stamps)} frames and {len(self.names)} names"
            wrong = f"`areas` is {self.areas.shape} for {shape}; at least one of each is needed"
        elif len(set(self.names)) != len(self.names):
            wrong = "two objects have one name"
        elif (np.diff(self.stamps) <= 0).any():
            wrong = "its times do not increase"
        elif self.areas.min() < 0 or self.areas.sum(axis=1).max() > self.width * self.height:
            wrong = "the areas of a frame are negative, or larger than the frame"
        elif self.scores is not None and (self.scores.min() < 0 or self.scores.max() > 1):
            wrong = "a score is not within 0 and 1"
        elif self.first is not None and self.first >= len(self.stamps):
            wrong = f"its first frame is number {self.first} of {len(self.stamps)}"
        if wrong:
            raise ArtifactError(
                f"MaskTrack: {wrong}", code="DXB-A525", hint="`MaskTrack.of` makes one from label maps, frame by frame"
            )
        return self

    @classmethod
    def of(
        cls, names: Sequence[str], stamps: np.ndarray, frames: Iterable[_Frame], first: int | None = None
    ) -> MaskTrack:
        """Encode label maps, one by one.

        Args:
            names: Name of label 1, 2, ...
            stamps: (N,) time of each frame [s].
            frames: For each frame, labels (H, W) uint8 and scores (K,), or None if the method has no scores.
            first: Number of the frame whose masks were given.

        Raises:
            ArtifactError: There are more or fewer frames than stamps, of different sizes, or with unnamed labels.
        """
        written = io.BytesIO()
        areas: list[np.ndarray] = []
        scores: list[np.ndarray] = []
        shape: tuple[int, ...] = ()
        with zipfile.ZipFile(written, "w") as archive:
            for number, (labels, sure) in enumerate(frames):
                shape = shape or labels.shape
                count = _areas(labels, len(names))
                if count is None or labels.shape != shape:
                    raise ArtifactError(
                        f"frame {number} of a MaskTrack does not fit",
                        code="DXB-A526",
                        facts={
                            "labels": f"{labels.dtype} {labels.shape}, up to {labels.max(initial=0)}",
                            "needed": f"uint8 {shape}, up to {len(names)}",
                        },
                    )
                areas.append(count)
                scores += [] if sure is None else [np.asarray(sure, np.float32)]
                archive.writestr(zipfile.ZipInfo(member(number), DAY), _indexed(labels))
        return cls(
            file=File(data=written.getvalue()),
            names=tuple(names),
            width=shape[1] if shape else 1,
            height=shape[0] if shape else 1,
            stamps=stamps,
            areas=np.array(areas, np.int32).reshape(-1, len(names)),
            scores=np.array(scores) if scores else None,
            first=first,
        )

    @property
    def seen(self) -> np.ndarray:
        """Whether each object is visible in each frame, (N, K) bool."""
        return self.areas > 0

    def labels(self, number: int) -> np.ndarray:
        """The label map of a frame, (H, W) uint8.

        Raises:
            ArtifactError: There is no such frame, or the archive is damaged.
        """
        return next(self._decoded([number]))

    def every(self) -> Iterator[np.ndarray]:
        """All label maps (H, W) uint8 in order, one at a time."""
        return self._decoded(range(len(self.stamps)))

    def _decoded(self, numbers: Iterable[int]) -> Iterator[np.ndarray]:
        with self.file.open() as raw:
            try:
                archive = zipfile.ZipFile(raw)
                for number in numbers:
                    yield indices(archive.read(member(number)), (self.height, self.width))
            except DAMAGE as error:
                raise unreadable("masks.zip", FORM, error) from None


def member(number: int) -> str:
    """Name of a frame in the archive."""
    return f"{number:05d}.png"


def _areas(labels: np.ndarray, most: int) -> np.ndarray | None:
    """Pixels of label 1, 2, ..., `most`; None if the map is not (H, W) uint8 or has other labels."""
    if labels.dtype != np.uint8 or labels.ndim != 2 or labels.max(initial=0) > most:
        return None
    return np.bincount(labels.reshape(-1), minlength=most + 1)[1:]


def _indexed(labels: np.ndarray) -> bytes:
    from PIL import Image as Pillow

    picture = Pillow.fromarray(np.ascontiguousarray(labels))
    picture.putpalette(palette().tobytes())  # turns a grey picture into an indexed one with the same numbers
    written = io.BytesIO()
    picture.save(written, format="PNG")
    return written.getvalue()


def indices(data: bytes, shape: tuple[int, int] | None = None) -> np.ndarray:
    """The indices of an indexed or grey PNG, (H, W) uint8.

    Raises:
        ValueError: It is another picture, or not (height, width).
    """
    from PIL import Image as Pillow

    with Pillow.open(io.BytesIO(data), formats=("PNG",)) as picture:
        if picture.mode not in ("P", "L") or (shape and picture.size != shape[::-1]):
            size = f"{picture.width} x {picture.height} px"
            raise ValueError(f"a frame is {size} of mode {picture.mode}, not an indexed picture of the declared size")
        return np.array(picture)


@cache
def palette() -> np.ndarray:
    """Colours of PASCAL VOC and DAVIS by label, (256, 3) uint8: bit 3 i + c of the label is bit 7 - i of channel c."""
    labels = np.arange(256)
    colours = np.zeros((256, 3), np.uint8)
    for bit in range(8):
        for channel in range(3):
            colours[:, channel] |= ((labels >> (3 * bit + channel)) & 1).astype(np.uint8) << np.uint8(7 - bit)
    colours.flags.writeable = False
    return colours

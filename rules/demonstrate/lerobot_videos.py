"""The video files of one camera in a LeRobotDataset: episodes joined up to a maximum size."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from dextera_build.formats.h264 import Clip, Encoder

from . import lerobot_meta, rolling

if TYPE_CHECKING:
    from .lerobot import LerobotOptions

MEGABYTE = 1024.0 * 1024.0
LONGEST_S = 1000.0
"""Maximum duration of a video file [s]: LeRobot's loader compares times in single precision to 0.1 ms, and above 1024 s
the spacing of single precision numbers is larger."""


class Videos:
    """Writes the files of one camera sequentially, with one episode in memory.

    Args:
        out: Folder of the data set.
        key: Name of the camera's feature.
        encoder: Encoder of all clips.
        options: Maximum size of a file, and files per folder.
    """

    def __init__(self, out: Path, key: str, encoder: Encoder, options: LerobotOptions) -> None:
        self._out, self._key, self._encoder, self._options = out, key, encoder, options
        self._roll = rolling.Roll(1.0, options.files_per_chunk)
        self._place: rolling.Place | None = None
        self._file = ExitStack()
        self._append: Callable[[Clip], None]
        self._frames = 0

    def add(self, clip: Clip) -> dict[str, object]:
        """Append an episode; return its columns of `meta/episodes`."""
        rate = self._encoder.rate
        limit = float(LONGEST_S * rate)
        size = max(clip.size / MEGABYTE / self._options.video_file_mb, len(clip.packets) / limit)
        place = self._roll.place(size)
        if place != self._place:
            self._open(place)
        self._append(clip)
        first, self._frames = self._frames, self._frames + len(clip.packets)
        return {
            f"videos/{self._key}/chunk_index": place.chunk,
            f"videos/{self._key}/file_index": place.file,
            f"videos/{self._key}/from_timestamp": float(first / rate),
            f"videos/{self._key}/to_timestamp": float(self._frames / rate),
        }

    def close(self) -> None:
        """Complete the last file."""
        self._file.close()

    def _open(self, place: rolling.Place) -> None:
        self._file.close()
        path = self._out / place.path(lerobot_meta.VIDEO, video_key=self._key)
        path.parent.mkdir(parents=True, exist_ok=True)
        self._append = self._file.enter_context(self._encoder.joined(path))
        self._place, self._frames = place, 0


@contextmanager
def videos(out: Path, key: str, encoder: Encoder, options: LerobotOptions) -> Iterator[Videos]:
    """`Videos` with the last file completed on exit."""
    files = Videos(out, key, encoder, options)
    try:
        yield files
    finally:
        files.close()

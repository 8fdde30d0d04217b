"""Distribute episodes over files of bounded size, in order, each in one file."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Place:
    """A file of a chunked folder."""

    chunk: int
    file: int

    def path(self, template: str, **names: str) -> str:
        """The file's path by LeRobot's template with `chunk_index` and `file_index`."""
        return template.format(chunk_index=self.chunk, file_index=self.file, **names)


class Roll:
    """Chooses the file of each episode in turn; an episode larger than `limit` gets its own file.

    Args:
        limit: Maximum sum of the sizes in one file.
        files_per_chunk: Files per folder.
    """

    def __init__(self, limit: float, files_per_chunk: int) -> None:
        self._limit, self._per = limit, files_per_chunk
        self._number, self._filled = 0, 0.0

    def place(self, size: float) -> Place:
        """The file of the next episode, which has this size."""
        if self._filled and self._filled + size > self._limit:
            self._number, self._filled = self._number + 1, 0.0
        self._filled += size
        return Place(*divmod(self._number, self._per))

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


def places(sizes: list[float], limit: float, files_per_chunk: int) -> list[Place]:
    """The file of every episode; an episode larger than `limit` gets its own file.

    Args:
        sizes: Size of each episode.
        limit: Maximum sum of the sizes in one file.
        files_per_chunk: Files per folder.
    """
    found: list[Place] = []
    number, filled = 0, 0.0
    for size in sizes:
        if filled and filled + size > limit:
            number, filled = number + 1, 0.0
        filled += size
        found.append(Place(*divmod(number, files_per_chunk)))
    return found


def grouped(where: list[Place]) -> dict[Place, list[int]]:
    """File -> indices of its episodes."""
    found: dict[Place, list[int]] = {}
    for position, place in enumerate(where):
        found.setdefault(place, []).append(position)
    return found

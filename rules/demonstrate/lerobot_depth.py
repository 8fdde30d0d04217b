"""Depth in a LeRobotDataset: one picture of 16 bits per step in the data files.

LeRobot from 0.6 on knows such a feature as a depth map, by `is_depth_map` and `depth_unit`, and returns millimetres or
metres. Its loaders before decode the picture all the same, as whole millimetres. Videos of depth, which 0.6 has, too,
are quantised, and earlier loaders would read them as colours.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from dextera_build.artifacts.tasks.episode import Film
from dextera_build.formats.ros.recording import packed
from dextera_build.policy.declared import BY_NAME

from . import lerobot_stats
from .cameras import Camera

LEVELS = 65536


class Depths:
    """The depth of all cameras that have it, episode by episode.

    Args:
        seen: The cameras.
    """

    def __init__(self, seen: Iterable[Camera]) -> None:
        self._films: dict[str, Film] = {
            BY_NAME["depth"].feature.format(each.name): each.film for each in seen if each.film and each.film.depth
        }
        self._counts = {key: np.zeros((1, LEVELS), np.int64) for key in self._films}
        self._frames = 0

    def described(self) -> dict[str, object]:
        """The entries of `meta/info.json`, by feature."""
        return {key: _feature(film) for key, film in self._films.items()}

    def of(self, label: str) -> tuple[dict[str, list[bytes]], dict[str, lerobot_stats.Stats]]:
        """Encoded pictures of an episode's steps, and their statistics [mm], by feature."""
        pictures: dict[str, list[bytes]] = {}
        stats: dict[str, lerobot_stats.Stats] = {}
        for key, film in self._films.items():
            counts = np.zeros((1, LEVELS), np.int64)
            pictures[key] = []
            for frame in film.each_depth(label):
                counts[0] += np.bincount(frame.ravel(), minlength=LEVELS)
                pictures[key].append(packed(frame, "png"))
            stats[key] = lerobot_stats.of_pictures(counts, len(pictures[key]), full=1.0)
            self._counts[key] += counts
        self._frames += max((len(each) for each in pictures.values()), default=0)
        return pictures, stats

    def whole(self) -> dict[str, lerobot_stats.Stats]:
        """Statistics of all episodes so far [mm], by feature."""
        counts: Mapping[str, np.ndarray] = self._counts
        return {key: lerobot_stats.of_pictures(each, self._frames, full=1.0) for key, each in counts.items()}


def _feature(film: Film) -> dict[str, object]:
    return {
        "dtype": "image",
        "shape": [film.height, film.width, 1],
        "names": ["height", "width", "channels"],
        "info": {"is_depth_map": True, "depth_unit": "mm"},
    }

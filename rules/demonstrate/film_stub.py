"""demonstrate.film without a renderer: a bar that grows with time, on a grey derived from the camera's pose."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from dextera_build import digest
from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.policy.observation import Frame
from dextera_build.rule import Backend, Context, Options

if TYPE_CHECKING:
    from .film import FilmOptions

BACKEND = Backend(summary="no rendering: a bar that grows with time, on a grey of its camera's own", profiles=("stub",))


def frames(
    ctx: Context, bundle: TaskBundle, episodes: Episodes, view: View, common: FilmOptions, options: Options
) -> Iterator[tuple[str, Frame]]:
    """Index and frames of each episode; all of the scene is one metre away."""
    # A different camera gives different pictures, as in a real film, so dependent nodes are rebuilt.
    grey = int(digest.of_bytes(np.ascontiguousarray(view.camera_pose.matrix).tobytes())[:2], 16) // 2
    for index, episode in episodes.items.items():
        steps = len(episode.joints)
        pixels = np.full((steps, view.camera.height, view.camera.width, 3), grey, np.uint8)
        for step in range(steps):
            pixels[step, :, : (step + 1) * view.camera.width // steps] = 200
        yield index, Frame(pixels, np.ones(pixels.shape[:3], np.float32) if common.depth else None)

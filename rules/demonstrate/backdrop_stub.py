"""demonstrate.backdrop without a renderer: the left half shows the robot, and backgrounds are grey."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.artifacts.tasks.variation import Twist
from dextera_build.rule import Backend, Context, Options

BACKEND = Backend(summary="no rendering: the robot is on the left, and backgrounds are grey", profiles=("stub",))


def masks(
    ctx: Context, bundle: TaskBundle, episodes: Episodes, view: View, camera: str, options: Options
) -> Iterator[tuple[str, np.ndarray]]:
    """Index and masks of each episode."""
    for index, episode in episodes.items.items():
        shown = np.zeros((len(episode.joints), view.camera.height, view.camera.width), bool)
        shown[:, :, : view.camera.width // 2] = True
        yield index, shown


def behind(
    ctx: Context, bundle: TaskBundle, view: View, draws: list[tuple[Twist, float]], options: Options
) -> Iterator[np.ndarray]:
    """Grey pictures."""
    for _, light in draws:
        yield np.full((view.camera.height, view.camera.width, 3), round(120 * light), np.uint8)


def among(
    ctx: Context, splats: Splats, view: View, draws: list[tuple[Twist, float]], options: Options
) -> Iterator[np.ndarray]:
    """The same."""
    for _, light in draws:
        yield np.full((view.camera.height, view.camera.width, 3), round(60 * light), np.uint8)

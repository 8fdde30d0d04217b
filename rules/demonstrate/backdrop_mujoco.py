"""demonstrate.backdrop rendered by MuJoCo, and Gaussians by a rasteriser on the CPU."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.artifacts.tasks.variation import Twist
from dextera_build.gaussians import splatting
from dextera_build.geometry import lie
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.observe import foreground

BACKEND = Backend(summary="MuJoCo through EGL", profiles=("cpu",), packages=("mujoco",), extra="twin")


def masks(
    ctx: Context, bundle: TaskBundle, episodes: Episodes, view: View, camera: str, options: Options
) -> Iterator[tuple[str, np.ndarray]]:
    """Index and masks of each episode."""
    return foreground.masks(bundle, episodes, view, camera)


def behind(
    ctx: Context, bundle: TaskBundle, view: View, draws: list[tuple[Twist, float]], options: Options
) -> Iterator[np.ndarray]:
    """Pictures of the scene without robot and objects."""
    return foreground.behind(bundle, view, draws)


def among(
    ctx: Context, splats: Splats, view: View, draws: list[tuple[Twist, float]], options: Options
) -> Iterator[np.ndarray]:
    """Pictures of the Gaussians."""
    camera, gaussians = view.camera, splats.gaussians
    for error, light in draws:
        pose = lie.retract(view.camera_pose.matrix, error)
        shown = splatting.render(gaussians, camera.matrix(), pose, (camera.height, camera.width), near_m=0.01)
        yield np.round(255 * (light * shown).clip(0, 1)).astype(np.uint8)

"""demonstrate.robot_film: pictures of episodes that were recorded on a robot."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice

import numpy as np
from pydantic import PositiveInt

from dextera_build.artifacts.base import File, Folder
from dextera_build.artifacts.tasks.episode import Episodes, Film
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.policy import robot_run
from dextera_build.policy.contract import check_data
from dextera_build.policy.observation import Frame
from dextera_build.rule import Context, Options, rule

from ..film_packing import film_of


class RobotFilmOptions(Options):
    """Options of demonstrate.robot_film."""

    strip_frames: PositiveInt = 8
    """Frames in the preview of the first episode."""


@rule(version=1, packages=("numpy", "pillow", "mcap", "mcap-ros2-support"))
def robot_film(
    ctx: Context,
    bundle: TaskBundle,
    runs: File | Folder,
    episodes: Episodes,
    view: View,
    *,
    options: RobotFilmOptions | None = None,
) -> Film:
    """Return one frame (H, W, 3) uint8 sRGB per step of the kept episodes that `demonstrate.recorded` made of `runs`.

    Frame t is the picture that had arrived last when the measurements before action t were taken. The camera must give
    pictures of the size of `view`.

    Raises:
        RuleError: A recording is missing, has pictures of no camera or of several, or of another size.
        ArtifactError: A file is damaged, or was not finished.
    """
    options = options or RobotFilmOptions()
    check_data(bundle, episodes)

    def taken() -> Iterator[tuple[str, Frame]]:
        for name, stream in robot_run.recordings(runs):
            if name not in episodes.items:
                continue
            _, pictures = robot_run.filmed(stream, f"{name}.mcap", bundle)
            frames = np.stack(list(islice(pictures, len(episodes.items[name].joints))))
            size, wanted = frames.shape[1:3], (view.camera.height, view.camera.width)
            ctx.check(
                size == wanted,
                f"the pictures of `{name}` have {size[1]} x {size[0]} px, `view` has {wanted[1]} x {wanted[0]}",
                hint="give `view` the size that the robot's camera gives, or let the driver scale its pictures",
            )
            yield name, Frame(frames)

    return film_of(ctx, episodes, view, taken(), options.strip_frames)

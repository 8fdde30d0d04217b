"""demonstrate.mcap: episodes as ROS 2 recordings."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Literal, Protocol

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.tasks.episode import Episodes, Film
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.rule import Context, Tolerance, rule

from . import form
from .writing import written

FORM = form.Form(
    "ROS 2 recordings in MCAP, one per episode",
    lambda term: term.topic,
    """
from mcap_ros2.reader import read_ros2_messages

for message in read_ros2_messages("episode-000000.mcap", topics=["/joint_states"]):
    print(message.log_time_ns, message.ros_msg.position)
""",
    notes=("In the recordings, quaternions follow ROS: x y z w. Time starts at 0 in every episode.",),
)


class McapOptions(form.FormOptions):
    """Options of demonstrate.mcap."""

    picture: Literal["png", "jpeg"] = "png"
    """Encoding of images; `png` is lossless."""
    compression: Literal["zstd", "none"] = "zstd"
    """Compression of the file's chunks."""


class McapBackend(Protocol):
    """Interface of a backend of demonstrate.mcap."""

    def write(
        self,
        ctx: Context,
        bundle: TaskBundle,
        episodes: Episodes,
        film: Film | None,
        view: View | None,
        out: Path,
        common: McapOptions,
        options: Any,
    ) -> None:
        """Write all files below `out`, an empty folder."""
        ...


# Numbers in its files are rounded differently on another processor, and bytes have no difference to bound.
@rule(version=2, packages=("numpy",), tolerance=Tolerance({"files": math.inf}, metrics={"size": 0.1}))
def mcap(
    ctx: Context[McapBackend],
    bundle: TaskBundle,
    episodes: Episodes,
    film: Film | None = None,
    view: View | None = None,
    *,
    options: McapOptions,
) -> Folder:
    """Return one MCAP file per kept episode, profile `ros2`, with joints, commands, frames, forces and images.

    The robot is `/robot_description` (URDF, also attached), objects are markers in their frames, so that viewers draw
    both.

    Time starts at 0 in every episode. Frames follow ROS: quaternions x y z w, camera frames with z forward.
    """
    form.check(ctx, episodes, film, view)
    folder, megabytes = written(ctx, bundle, episodes, film, view, FORM, options)
    recordings = sum(name.endswith(".mcap") for name in folder.files)
    ctx.check(recordings == len(episodes.items), "episodes were lost")
    ctx.say(f"{recordings} recordings, {'with' if film else 'without'} pictures, {megabytes:.1f} MB")
    return folder

"""demonstrate.mcap: episodes as ROS 2 recordings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, Protocol

from pydantic import Field, PositiveInt

from dextera_build.artifacts.base import Collection, Folder
from dextera_build.artifacts.tasks.episode import Episodes, Film
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.rule import Context, Tolerance, rule

from . import form
from .cameras import Camera, Given
from .mcap_place import place
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

    picture: Literal["png", "jpeg", "h264"] = "png"
    """Encoding of images: `png` is lossless; `h264` is the smallest, on the topic `/<camera>/color/video`."""
    quality: int = Field(92, ge=1, le=100)
    """Quality of JPEG."""
    qp: int = Field(22, ge=1, le=51)
    """Quantisation parameter of H.264, constant: 1 is best, 51 is worst."""
    keyframe_every: PositiveInt = 20
    """Key frame interval of H.264; a reader decodes at most this many frames to get one."""
    shapes: Literal["each", "beside"] = "each"
    """Where the robot's description and the shapes of the scene are: in each recording, or once, in `scene.mcap`, which
    Foxglove opens together with a recording. A recording whose start scales objects has the shapes of these itself."""
    compression: Literal["zstd", "none"] = "zstd"
    """Compression of the file's chunks."""


class McapBackend(Protocol):
    """Interface of a backend of demonstrate.mcap."""

    def write(
        self,
        ctx: Context,
        bundle: TaskBundle,
        episodes: Episodes,
        seen: Sequence[Camera],
        out: Path,
        common: McapOptions,
        options: Any,
    ) -> None:
        """Write all files below `out`, an empty folder."""
        ...


# Numbers in its files are rounded differently on another processor, and bytes have no difference to bound.
@rule(version=3, packages=("numpy",), tolerance=Tolerance({"files": math.inf}, metrics={"size": 0.1}))
def mcap(
    ctx: Context[McapBackend],
    bundle: TaskBundle,
    episodes: Episodes,
    film: Film | None = None,
    view: View | None = None,
    films: Collection[Film] | None = None,
    views: Collection[View] | None = None,
    *,
    options: McapOptions,
) -> Folder:
    """Return one MCAP file per kept episode, profile `ros2`, with joints, commands, frames, forces and images.

    The robot is `/robot_description` (URDF, also attached), objects are markers in their frames, so that viewers draw
    both. `film` and `view` are of one camera, `films` and `views` of several by name; depth is `16UC1`.

    Time starts at 0 in every episode. Frames follow ROS: quaternions x y z w, camera frames with z forward.
    """
    seen = form.checked(ctx, episodes, Given(film, view, films, views), options)
    for one in (each.film for each in seen if each.film is not None and options.picture == "h264"):
        ctx.check(one.width % 2 == one.height % 2 == 0, "H.264 takes pictures of even width and height")
    described = replace(FORM, place=lambda term: place(term, options.picture))
    folder, megabytes = written(ctx, bundle, episodes, seen, described, options)
    recordings = sum(name.startswith("episode-") for name in folder.files)
    ctx.check(recordings == len(episodes.items), "episodes were lost")
    pictures = "with" if any(each.film for each in seen) else "without"
    ctx.say(f"{recordings} recordings, {pictures} pictures, {megabytes:.1f} MB")
    return folder

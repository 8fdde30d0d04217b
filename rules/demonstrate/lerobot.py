"""demonstrate.lerobot: episodes as a LeRobotDataset."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, Protocol

from pydantic import Field, PositiveFloat, PositiveInt

from dextera_build.artifacts.base import Collection, Folder
from dextera_build.artifacts.tasks.episode import Episodes, Film
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.rule import Context, Tolerance, rule

from . import form
from .cameras import Camera, Given
from .writing import written

LOAD = """
from lerobot.datasets.lerobot_dataset import LeRobotDataset

data = LeRobotDataset("local/data", root=".")
print(len(data), data[0]["observation.state"], data[0]["action"])
"""


class LerobotOptions(form.FormOptions):
    """Options of demonstrate.lerobot."""

    version: Literal["v3.0", "v2.1"] = "v3.0"
    """Format: `v3.0` for LeRobot from 0.4 on; `v2.1` with `meta/modality.json` for LeRobot up to 0.3, openpi and
    GR00T, with a file per episode."""
    data_file_mb: PositiveFloat = 100.0
    """Maximum size of the numbers in a data file [MB]."""
    video_file_mb: PositiveFloat = 200.0
    """Maximum size of a video file [MB]."""
    files_per_chunk: PositiveInt = 1000
    """Files per folder."""
    qp: int = Field(22, ge=1, le=51)
    """Quantisation parameter of H.264, constant: 1 is best, 51 is worst; 22 is as good as `-crf 18` of ffmpeg."""
    keyframe_every: PositiveInt = 5
    """Key frame interval; a reader decodes at most this many frames to get one."""


class LerobotBackend(Protocol):
    """Interface of a backend of demonstrate.lerobot."""

    def write(
        self,
        ctx: Context,
        bundle: TaskBundle,
        episodes: Episodes,
        seen: Sequence[Camera],
        out: Path,
        common: LerobotOptions,
        options: Any,
    ) -> None:
        """Write all files below `out`, an empty folder."""
        ...


# Numbers in its files are rounded differently on another processor, and bytes have no difference to bound.
@rule(version=1, packages=("numpy",), tolerance=Tolerance({"files": math.inf}, metrics={"size": 0.1}))
def lerobot(
    ctx: Context[LerobotBackend],
    bundle: TaskBundle,
    episodes: Episodes,
    film: Film | None = None,
    view: View | None = None,
    films: Collection[Film] | None = None,
    views: Collection[View] | None = None,
    *,
    options: LerobotOptions,
) -> Folder:
    """Return a folder for LeRobot's loader: data, a video for each film, statistics, episodes, tasks.

    `film` and `view` are of one camera, `films` and `views` of several by name. Depth is a feature of its own.

    In addition to LeRobot's columns, every episode keeps its start (`start/...` in `meta/episodes`), its origin and its
    segments, so that it can be rerun; `meta/dextera.json` describes the whole set.
    """
    seen = form.checked(ctx, episodes, Given(film, view, films, views), options)
    for one in (each.film for each in seen if each.film is not None):
        if one.width % 2 or one.height % 2:
            ctx.fail(
                "videos need an even width and height",
                film=f"{one.width} x {one.height} px",
                hint="choose an even `width_px` and `height_px` in simulate.view",
            )
    folder, megabytes = written(ctx, bundle, episodes, seen, described(seen, options), options)
    info = json.loads(folder.files["meta/info.json"])
    steps = sum(len(episode.joints) for episode in episodes.items.values())
    ctx.check(info["total_episodes"] == len(episodes.items), "episodes were lost")
    ctx.check(info["total_frames"] == steps, "steps were lost")
    videos = sum(name.endswith(".mp4") for name in folder.files)
    ctx.say(f"{len(episodes.items)} episodes, {steps:,} steps, {videos} video files, {megabytes:.1f} MB")
    return folder


def described(seen: Sequence[Camera], options: LerobotOptions) -> form.Form:
    """The form, for its card."""
    new = options.version == "v3.0"
    kept = "`meta/episodes`" if new else "`meta/episodes.jsonl`"
    notes = [f"{kept} holds the start of every episode, and `meta/dextera.json` the task."]
    if any(each.film is not None for each in seen):
        notes.append("Pictures are H.264 videos, which lose detail.")
    if any(each.has_depth for each in seen):
        notes.append("Depth is lossless: 16-bit PNG in the data files, in millimetres, marked `is_depth_map`.")
    return form.Form(
        f"a LeRobotDataset {options.version}, for LeRobot {'from 0.4 on' if new else 'up to 0.3, openpi and GR00T'}",
        lambda term: term.feature,
        LOAD,
        notes=tuple(notes),
        header={
            "tags": ["LeRobot"],
            "configs": [{"config_name": "default", "data_files": "data/*/*.parquet"}],
        },
    )

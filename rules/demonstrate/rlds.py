"""demonstrate.rlds: episodes as a data set of TensorFlow Datasets in the layout of RLDS, which OpenVLA reads."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, Protocol

from pydantic import Field, PositiveFloat

from dextera_build.artifacts.base import Collection, Folder
from dextera_build.artifacts.tasks.episode import Episodes, Film
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.policy.declared import BY_NAME
from dextera_build.rule import Context, Tolerance, rule

from . import form, rlds_names
from .cameras import Camera, Given
from .lerobot_features import ACTION
from .writing import written

VERSION = "1.0.0"
"""Version of every data set, as its folder is called."""
LOAD = """
import tensorflow_datasets as tfds

builder = tfds.builder_from_directory("NAME/VERSION")
for episode in builder.as_dataset(split="train"):
    for step in episode["steps"]:
        print(step["language_instruction"], step["observation"]["state"], step["action"])
"""


class RldsOptions(form.FormOptions):
    """Options of demonstrate.rlds."""

    name: str = Field("", pattern=r"^([a-z][a-z0-9_]*)?$")
    """Name of the data set, `[a-z][a-z0-9_]*`; empty: the task's, `CloseLaptop` as `close_laptop`."""
    picture: Literal["jpeg", "png"] = "jpeg"
    """Encoding of images; `png` is lossless."""
    shard_mb: PositiveFloat = 200.0
    """Size from which a file is followed by another one [MB]."""
    valid_share: float = Field(0.1, ge=0, lt=1)
    """Expected share of the starts to validate on; their episodes are split `val`, the others `train`."""


class RldsBackend(Protocol):
    """Interface of a backend of demonstrate.rlds."""

    def write(
        self,
        ctx: Context,
        bundle: TaskBundle,
        episodes: Episodes,
        seen: Sequence[Camera],
        out: Path,
        common: RldsOptions,
        options: Any,
    ) -> None:
        """Write all files of the data set into `out`, an empty folder."""
        ...


# Numbers in its files are rounded differently on another processor, and bytes have no difference to bound.
@rule(version=1, packages=("numpy",), tolerance=Tolerance({"files": math.inf}, metrics={"size": 0.1}))
def rlds(
    ctx: Context[RldsBackend],
    bundle: TaskBundle,
    episodes: Episodes,
    film: Film | None = None,
    view: View | None = None,
    films: Collection[Film] | None = None,
    views: Collection[View] | None = None,
    *,
    options: RldsOptions,
) -> Folder:
    """Return a folder `<name>/1.0.0` that `tfds.builder_from_directory` opens without code of its own.

    A step has `observation` (`image` and `depth` of `film`, `<name>_image` and `<name>_depth` of each of several
    `films`, `state`, `environment_state`, `goal`), `action` in the units of the task, `reward` (1 at the step that ends
    a success), `discount`, `is_first`, `is_last`, `is_terminal` and `language_instruction`. `episode_metadata` has the
    start, so that the episode can be rerun; every entry is one text or number, because OpenVLA repeats it for every
    step.
    """
    seen = form.checked(ctx, episodes, Given(film, view, films, views), options)
    inside = f"{name(bundle, options)}/{VERSION}"
    folder, megabytes = written(ctx, bundle, episodes, seen, described(bundle, seen, options), options, inside)
    info = json.loads(folder.files[f"{inside}/dataset_info.json"])
    told = sum(int(length) for split in info["splits"] for length in split["shardLengths"])
    ctx.check(told == len(episodes.items), "episodes were lost")
    sides = ", ".join(f"{sum(map(int, split['shardLengths']))} {split['name']}" for split in info["splits"])
    pictures = "with" if any(each.film for each in seen) else "without"
    ctx.say(f"{len(episodes.items)} episodes ({sides}) {pictures} pictures, {megabytes:.1f} MB")
    return folder


def name(bundle: TaskBundle, options: RldsOptions) -> str:
    """Name of the data set."""
    words = re.findall(r"[A-Z]?[^A-Z\W_]+|[A-Z]+", bundle.task.name)
    return options.name or "_".join(words).lower()


def described(bundle: TaskBundle, seen: Sequence[Camera], options: RldsOptions) -> form.Form:
    """The form, for its card."""
    depth = ("Depth is 16-bit PNG, in millimetres; 0 is what was not measured.",)
    return form.Form(
        "a data set of TensorFlow Datasets in the layout of RLDS",
        lambda term: _place(term.feature, len(seen) > 1),
        LOAD.replace("NAME", name(bundle, options)).replace("VERSION", VERSION),
        notes=(
            f"Pictures are {options.picture.upper()}. Actions have the units of the table and are not scaled; OpenVLA "
            "scales by quantiles that it computes. Splits are `train` and `val`; no start is in both.",
            *(depth if any(each.has_depth for each in seen) else ()),
        ),
    )


def _place(feature: str, several: bool) -> str:
    """Where a feature is in a step, `{}` for one of several cameras; empty: nowhere."""
    if feature.startswith(form.OBSERVED):
        name = feature.removeprefix(form.OBSERVED)
        kinds = {BY_NAME["rgb"].feature: rlds_names.PICTURE, BY_NAME["depth"].feature: rlds_names.DEPTH}
        picture = kinds.get(feature)
        return f"observation/{name if picture is None else rlds_names.key(picture, several)}"
    return ACTION if feature == ACTION else ""

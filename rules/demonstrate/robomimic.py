"""demonstrate.robomimic: episodes as the HDF5 file of robomimic."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

from pydantic import Field, PositiveFloat

from dextera_build.artifacts.base import Collection, Folder
from dextera_build.artifacts.tasks.episode import Episodes, Film
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.rule import Context, Tolerance, rule

from . import form, robomimic_names
from .cameras import Camera, Given
from .lerobot_actions import Actions
from .writing import written

LOAD = """
from robomimic.utils import obs_utils
from robomimic.utils.dataset import SequenceDataset

numbers, pictures, depth = NUMBERS, PICTURES, DEPTH
obs_utils.initialize_obs_utils_with_obs_specs([{"obs": {"low_dim": numbers, "rgb": pictures, "depth": depth}}])
data = SequenceDataset(
    "demo.hdf5",
    obs_keys=numbers + pictures + depth,
    dataset_keys=["actions"],
    filter_by_attribute="train",
    seq_length=10,
)
print(len(data), data[0]["actions"].shape)
"""


class RobomimicOptions(form.FormOptions):
    """Options of demonstrate.robomimic."""

    valid_share: float = Field(0.1, ge=0, lt=1)
    """Expected share of the starts to validate on; their episodes are filter key `valid`, the others `train`."""
    reach_m: PositiveFloat = 3.0
    """Distance that is 1 in the scaled depth [m]; what is farther away is 0, as what was not measured."""


class RobomimicBackend(Protocol):
    """Interface of a backend of demonstrate.robomimic."""

    def write(
        self,
        ctx: Context,
        bundle: TaskBundle,
        episodes: Episodes,
        seen: Sequence[Camera],
        out: Path,
        common: RobomimicOptions,
        options: Any,
    ) -> None:
        """Write `demo.hdf5` below `out`, an empty folder."""
        ...


# Numbers in its file are rounded differently on another processor, and bytes have no difference to bound.
@rule(version=1, packages=("numpy",), tolerance=Tolerance({"files": math.inf}, metrics={"size": 0.1}))
def robomimic(
    ctx: Context[RobomimicBackend],
    bundle: TaskBundle,
    episodes: Episodes,
    film: Film | None = None,
    view: View | None = None,
    films: Collection[Film] | None = None,
    views: Collection[View] | None = None,
    *,
    options: RobomimicOptions,
) -> Folder:
    """Return a folder with one HDF5 file for robomimic's loader.

    `film` and `view` are of one camera, `films` and `views` of several by name. Actions are scaled from the limits of
    the task's actions to [-1, 1], depth to [0, 1]; the limits are attributes of the group `data`.
    Episode i is `data/demo_i`; its attributes hold its start, so that it can be rerun.
    """
    seen = form.checked(ctx, episodes, Given(film, view, films, views), options)
    folder, megabytes = written(ctx, bundle, episodes, seen, described(bundle, episodes, seen, options), options)
    ctx.check(robomimic_names.FILE in folder.files, "the file is missing")
    steps = sum(len(episode.joints) for episode in episodes.items.values())
    pictures = "with" if any(each.film for each in seen) else "without"
    ctx.say(f"{len(episodes.items)} demonstrations, {steps:,} steps {pictures} pictures, {megabytes:.1f} MB")
    return folder


def described(bundle: TaskBundle, episodes: Episodes, seen: Sequence[Camera], options: RobomimicOptions) -> form.Form:
    """The form, for its card."""
    numbers = [robomimic_names.observed(name) for name in form.observed(bundle, episodes, Actions(bundle))]
    pictures = [robomimic_names.PICTURE.format(each.name) for each in seen if each.film is not None]
    depth = [robomimic_names.DEPTH.format(each.name) for each in seen if each.has_depth]
    scaled = (
        f"Depth is scaled to 0..1, as robomimic takes it: 1 is {options.reach_m:g} m, the attribute `depth_reach_m` of "
        "the group `data`; 0 is what was not measured or is farther away.",
    )
    return form.Form(
        "an HDF5 file for robomimic",
        lambda term: robomimic_names.place(term.feature),
        LOAD.replace("NUMBERS", json.dumps(numbers))
        .replace("PICTURES", json.dumps(pictures))
        .replace("DEPTH", json.dumps(depth)),
        depth_unit=f"{options.reach_m:g} m",
        notes=(
            "Actions are scaled to -1..1: `action = lower + (actions + 1) / 2 * (upper - lower)`, with the attributes "
            "`action_lower` and `action_upper` of the group `data`.",
            "`states` are positions of MuJoCo's model of the task. Filter keys are `train` and `valid`; no start is in "
            "both.",
            *(scaled if depth else ()),
        ),
    )

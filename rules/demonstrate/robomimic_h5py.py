"""demonstrate.robomimic written with h5py."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from dextera_build.artifacts.tasks.episode import DEPTH_STEP_M, Episode, Episodes
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.render.filming import Replica

from . import facts, form, lerobot_features, robomimic_names, split
from .lerobot_actions import Actions

if TYPE_CHECKING:
    from .cameras import Camera
    from .robomimic import RobomimicOptions

BACKEND = Backend(summary="HDF5 by h5py", profiles=("cpu",), packages=("h5py", "mujoco"), extra="learn")
GYM = 2
"""robomimic's number of environments that Gym makes."""


def write(
    ctx: Context,
    bundle: TaskBundle,
    episodes: Episodes,
    seen: Sequence[Camera],
    out: Path,
    common: RobomimicOptions,
    options: Options,
) -> None:
    """Write `demo.hdf5` below `out`; its bytes follow from the arguments."""
    actions, replica = Actions(bundle), Replica(bundle, episodes)
    ordered = episodes.in_order()
    taken = [actions.of(episode) for _, episode in ordered]
    scale = Scale(actions, taken)
    if scale.widened:
        ctx.log(f"actions beyond their limits, which the scale includes: {', '.join(scale.widened)}")
    valid = split.validation(episodes, common.valid_share)
    sides: dict[str, list[str]] = {"train": [], "valid": []}
    with h5py.File(out / robomimic_names.FILE, "w") as file:
        data = file.create_group("data")
        for number, (label, episode) in enumerate(ordered):
            demo = data.create_group(f"demo_{number}")
            sides["valid" if label in valid else "train"].append(f"demo_{number}")
            _numbers(demo, form.observed(bundle, episodes, actions), episodes, episode, scale.of(taken[number]))
            demo["states"] = replica.positions(episode)
            _about(demo, label, episode, facts.instruction(bundle, common))
            for each in seen:
                _seen(demo, each, label, len(episode.joints), common)
            ctx.progress(number + 1, len(ordered), "demonstrations")
        _whole(data, bundle, episodes, actions, scale)
        if cameras := facts.cameras(bundle, seen):
            data.attrs["cameras"] = facts.document(cameras).decode()
        if any(each.has_depth for each in seen):
            data.attrs["depth_reach_m"] = common.reach_m
        for side, demos in sides.items():
            if demos:
                file[f"mask/{side}"] = np.array(demos, "S")


class Scale:
    """Scales actions from their limits to [-1, 1].

    Args:
        actions: The actions of the task, with their limits.
        taken: Actions (T, N) of the episodes; limits that one of them exceeds are widened to include it.
    """

    def __init__(self, actions: Actions, taken: list[np.ndarray]) -> None:
        whole = np.concatenate(taken).astype(np.float64)
        spec = actions.spec
        self.lower = np.minimum(spec.lower, whole.min(axis=0))
        """What becomes -1 (N,)."""
        self.upper = np.maximum(spec.upper, whole.max(axis=0))
        """What becomes 1 (N,)."""
        beyond = (self.lower < spec.lower) | (self.upper > spec.upper)
        self.widened = [name for name, wide in zip(spec.names, beyond, strict=True) if wide]
        """Names of the numbers whose limits were widened."""

    def of(self, actions: np.ndarray) -> np.ndarray:
        """Actions (T, N), scaled."""
        span = np.where(self.upper > self.lower, self.upper - self.lower, 1.0)
        scaled: np.ndarray = 2.0 * (actions.astype(np.float64) - self.lower) / span - 1.0
        return scaled.clip(-1.0, 1.0).astype(np.float32)


def _numbers(demo: Any, names: Iterable[str], episodes: Episodes, episode: Episode, scaled: np.ndarray) -> None:
    """Observations, those of the step after, scaled actions, commands that were sent, rewards and ends."""
    columns = lerobot_features.columns(episodes, episode, 0, 0)
    last = columns["next.done"].ravel()
    for name in names:
        values = columns[form.OBSERVED + name]
        demo[f"obs/{robomimic_names.observed(name)}"] = values
        demo[f"next_obs/{robomimic_names.observed(name)}"] = _after(values)
    demo[robomimic_names.ACTIONS] = scaled
    demo[robomimic_names.EXECUTED] = episode.executed
    demo["rewards"] = columns["next.success"].ravel().astype(np.float64)
    demo["dones"] = last.astype(np.int64)


def _after(values: np.ndarray) -> np.ndarray:
    """Values (T, ...) of the step after each; the last step has none and repeats its own."""
    return np.concatenate([values[1:], values[-1:]])


def _seen(demo: Any, camera: Camera, label: str, steps: int, options: RobomimicOptions) -> None:
    """Pictures (T, H, W, 3) uint8 and depth (T, H, W, 1) float32 in 0..1 of a camera."""
    film = camera.film
    if film is None:
        return
    size = (steps, film.height, film.width)
    _pictures(demo, robomimic_names.PICTURE.format(camera.name), (*size, 3), "uint8", film.each(label))
    if camera.has_depth:
        depth = (_scaled(counts, options.reach_m)[..., None] for counts in film.each_depth(label))
        _pictures(demo, robomimic_names.DEPTH.format(camera.name), (*size, 1), "float32", depth)


def _scaled(counts: np.ndarray, reach_m: float) -> np.ndarray:
    """Distances (H, W) in counts of `DEPTH_STEP_M` as float32 in 0..1, 0 beyond `reach_m`."""
    parts = counts * np.float32(DEPTH_STEP_M / reach_m)
    return np.where(parts <= 1.0, parts, np.float32(0.0))


def _pictures(demo: Any, name: str, shape: tuple[int, ...], kind: str, frames: Iterable[np.ndarray]) -> None:
    """Frames (T, H, W, C), compressed; those of the step after are views of the same bytes."""
    compressed = {"compression": "gzip", "shuffle": kind != "uint8"}
    pictures = demo.create_dataset(f"obs/{name}", shape, kind, chunks=(1, *shape[1:]), **compressed)
    for number, frame in enumerate(frames):
        pictures[number] = frame
    steps = shape[0]
    # `create_virtual_dataset` would write the time of the day.
    virtual = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    virtual.set_obj_track_times(False)
    for first, taken, count in ((0, 1, steps - 1), (steps - 1, steps - 1, 1)):
        if count:
            virtual.set_virtual(_rows(shape, first, count), b".", pictures.name.encode(), _rows(shape, taken, count))
    space = h5py.h5s.create_simple(shape)
    h5py.h5d.create(demo["next_obs"].id, name.encode(), pictures.id.get_type(), space, dcpl=virtual)


def _rows(shape: tuple[int, ...], first: int, count: int) -> Any:
    """The part of an array of this shape from row `first` on."""
    space = h5py.h5s.create_simple(shape)
    space.select_hyperslab((first, *[0] * (len(shape) - 1)), (count, *shape[1:]))
    return space


def _about(demo: Any, label: str, episode: Episode, words: str) -> None:
    """Attributes of one demonstration: its length, its words, and its start."""
    start = facts.start(label, episode)
    demo.attrs["num_samples"] = len(episode.joints)
    demo.attrs["ep_meta"] = json.dumps({"lang": words})
    for name, value in start.items():
        demo.attrs[name.replace("/", "_")] = value


def _whole(data: Any, bundle: TaskBundle, episodes: Episodes, actions: Actions, scale: Scale) -> None:
    """Attributes of the data set."""
    about = facts.about(bundle, episodes)
    name = f"dxb/{bundle.task.name}-{bundle.robot.model_name}-v0"
    data.attrs["env_args"] = json.dumps({"env_name": name, "type": GYM, "env_kwargs": {"action": bundle.task.action}})
    data.attrs["total"] = sum(len(episode.joints) for episode in episodes.items.values())
    data.attrs["action_names"] = list(actions.spec.names)
    data.attrs["action_lower"] = scale.lower
    data.attrs["action_upper"] = scale.upper
    data.attrs["states"] = "MuJoCo's qpos of the task's model; in world frame, metres and radians, quaternions w x y z"
    data.attrs["dextera"] = facts.document(about).decode()

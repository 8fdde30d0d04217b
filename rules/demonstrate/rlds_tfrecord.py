"""demonstrate.rlds written as TFRecords, without TensorFlow."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.core import trees
from dextera_build.artifacts.tasks.episode import Episode, Episodes
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.formats import tfrecord
from dextera_build.formats.ros.recording import packed
from dextera_build.rule import Backend, Context, Options

from . import facts, form, lerobot_features, rlds_meta, rlds_names, split
from .lerobot_actions import Actions

if TYPE_CHECKING:
    from .cameras import Camera
    from .rlds import RldsOptions

BACKEND = Backend(
    summary="TFRecords by protobuf and google-crc32c",
    profiles=("cpu",),
    packages=("protobuf", "google-crc32c", "pillow"),
    extra="learn",
)


def write(
    ctx: Context,
    bundle: TaskBundle,
    episodes: Episodes,
    seen: Sequence[Camera],
    out: Path,
    common: RldsOptions,
    options: Options,
) -> None:
    """Write all files into `out`, `<name>/<version>`."""
    actions, name = Actions(bundle), out.parent.name
    ordered = episodes.in_order()
    valid = split.validation(episodes, common.valid_share)
    sides = {
        "train": [(label, episode) for label, episode in ordered if label not in valid],
        "val": [(label, episode) for label, episode in ordered if label in valid],
    }
    splits, done = [], count(1)

    def messages(own: list[tuple[str, Episode]]) -> Iterator[bytes]:
        for label, episode in own:
            yield _message(bundle, episodes, label, episode, actions, seen, common)
            ctx.progress(next(done), len(ordered), "episodes")

    for side, own in sides.items():
        if own:
            splits.append(_split(out, name, side, messages(own), common.shard_mb * 1e6))
    observed = form.observed(bundle, episodes, actions)
    about = rlds_meta.about(bundle, episodes, seen)
    trees.write(
        {
            "features.json": rlds_meta.features(observed, len(actions.spec.names), seen, common),
            "dataset_info.json": rlds_meta.info(name, out.name, about, splits),
        },
        out,
    )


def _split(out: Path, name: str, side: str, messages: Iterable[bytes], limit: float) -> rlds_meta.Split:
    """Write the files of a split; one that reached `limit` bytes is followed by another."""
    lengths: list[int] = []
    size = 0
    for message in messages:
        if not lengths or (out / f"{side}-{len(lengths) - 1}").stat().st_size >= limit:
            lengths.append(0)
        with (out / f"{side}-{len(lengths) - 1}").open("ab") as file:
            tfrecord.append(file, message)
        lengths[-1] += 1
    for number in range(len(lengths)):
        path = out / f"{side}-{number}"
        size += path.stat().st_size
        path.rename(out / rlds_meta.file(name, side, number, len(lengths)))
    return rlds_meta.Split(side, tuple(lengths), size)


def _message(
    bundle: TaskBundle,
    episodes: Episodes,
    label: str,
    episode: Episode,
    actions: Actions,
    seen: Sequence[Camera],
    common: RldsOptions,
) -> bytes:
    """One episode: the numbers of all steps one after another, under the path of their feature."""
    columns = lerobot_features.columns(episodes, episode, 0, 0)
    steps = len(episode.joints)
    last = columns["next.done"].ravel()
    success = columns["next.success"].ravel()
    words = facts.instruction(bundle, common).encode()
    found: dict[str, tfrecord.Value] = {
        f"observation/{name}": columns[form.OBSERVED + name] for name in form.observed(bundle, episodes, actions)
    }
    found |= _pictures(seen, label, common)
    found |= {
        lerobot_features.ACTION: actions.of(episode),
        "reward": success.astype(np.float32),
        "discount": np.ones(steps, np.float32),
        "is_first": np.arange(steps) == 0,
        "is_last": last,
        "is_terminal": success,
        "language_instruction": [words] * steps,
    }
    start = facts.start(label, episode)
    begin = {key.removeprefix("start/"): value for key, value in start.items() if key.startswith("start/")}
    begin["dynamics"] = json.loads(str(begin["dynamics"]))
    texts = {"label": label, "origin": episode.origin, "start": json.dumps(begin), "segments": str(start["segments"])}
    return tfrecord.example(
        {f"steps/{key}": value for key, value in found.items()}
        | {f"episode_metadata/{key}": [texts[key].encode()] for key in rlds_meta.TEXTS}
        | {"episode_metadata/success": np.array([episode.success])}
        | {"episode_metadata/seed": np.array([episode.start.seed])}
    )


def _pictures(seen: Sequence[Camera], label: str, options: RldsOptions) -> dict[str, tfrecord.Value]:
    """Encoded pictures and depth of all steps, under the path of their feature."""
    found: dict[str, tfrecord.Value] = {}
    picture, depth = (
        f"observation/{rlds_names.key(kind, len(seen) > 1)}" for kind in (rlds_names.PICTURE, rlds_names.DEPTH)
    )
    for each in seen:
        if each.film is not None:
            found[picture.format(each.name)] = [packed(frame, options.picture) for frame in each.film.each(label)]
        if each.film is not None and each.has_depth:
            found[depth.format(each.name)] = [packed(frame, "png") for frame in each.film.each_depth(label)]
    return found

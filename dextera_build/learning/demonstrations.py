"""Training data of imitation learning: normalised inputs and actions, split by episode."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from dextera_build import digest
from dextera_build.artifacts.tasks.policy import SEEN, Channel, PolicyContract
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.errors import RuleError
from dextera_build.learning.parts import Part, check
from dextera_build.learning.sight import Sight
from dextera_build.policy import cameras, features, normalisation
from dextera_build.policy import contract as contracts
from dextera_build.policy.layout import WORLD, Layout, of_bundle, of_episodes, world_flag
from dextera_build.sim.primitives.catalogue import concerned

FITTED = 200
"""Maximum number of steps of a part whose depth gives its normalisation."""
Settings = Mapping[str, float | int | str | bool]


@dataclass(frozen=True)
class Selection:
    """The part of the recorded data that an algorithm learns from."""

    inputs: tuple[str, ...]
    """Input channels of the deployable observation; `rgb` are the pictures of all cameras that there are films of."""
    objects: Literal["task", "all"] = "task"
    """Objects with poses and joints in the input: the task's object and those that its goal names, or all."""
    held_out: float = 0.0
    """Fraction of the episodes held out for validation."""
    seed: int = 0
    """Seed of the split."""
    reach_m: float = 3.0
    """Distance from the camera above which neither depth nor points are used [m]."""


@dataclass(frozen=True)
class Demonstrations:
    """All steps of all episodes, one row each, in episode order."""

    contract: PolicyContract
    """Inputs and outputs of the policy, with the normalisation of the training episodes."""
    inputs: dict[str, np.ndarray]
    """Vector channel -> (N, tokens, features) float32, normalised."""
    actions: np.ndarray
    """Normalised joint targets before noise, (N, A) float32."""
    first: np.ndarray
    """First row of each row's episode, (N,) int64."""
    last: np.ndarray
    """Last row of each row's episode, (N,) int64."""
    train: tuple[str, ...]
    """Training episodes."""
    held_out: tuple[str, ...]
    """Validation episodes."""
    train_rows: tuple[np.ndarray, ...]
    """Rows of the training episodes of each part, (n,) int64."""
    weights: tuple[int, ...]
    """Samples of each part in a batch, relative to the others."""
    held_out_rows: np.ndarray
    """Rows of the validation episodes, (m,) int64."""
    sight: Mapping[str, Sight]
    """Camera -> what it showed at all rows."""
    places: np.ndarray | None
    """Normalised pose and joints of the task's object, (N, P) float32; None without images."""


def prepare(
    bundle: TaskBundle, parts: Sequence[Part], selection: Selection, *, algorithm: str, settings: Settings
) -> Demonstrations:
    """Check and normalise the data; the normalisation comes only from the training episodes, weighted as batches are.

    Args:
        bundle: The task.
        parts: Its demonstrations, and their pictures for the inputs of a camera.
        selection: Inputs to learn from.
        algorithm: Name of the algorithm, for the contract.
        settings: Settings that the algorithm needs to run the policy, for the contract.

    Raises:
        RuleError: The data do not fit the task or the selection.
    """
    first = parts[0]
    selection = replace(selection, inputs=cameras.spread(selection.inputs, first.films))
    check(bundle, parts, selection.inputs)
    layout = of_episodes(first.episodes, of_bundle(bundle).goal, first.films)
    rows, train, held_out = _split(parts, selection)
    every = [episode for part in parts for episode in part.episodes.items.values()]
    recorded = [
        features.recorded(episode) | {WORLD: np.tile(world_flag(part.episodes.world), (len(episode.action), 1))}
        for part in parts
        for episode in part.episodes.items.values()
    ]
    fields = {name: np.concatenate([part[name] for part in recorded]) for name in recorded[0]}
    actions = np.concatenate([episode.action for episode in every])
    mix = _Mix(tuple(rows), tuple(part.weight for part in parts))
    sight = {camera: Sight.of(parts, camera) for camera in first.films}
    channels = _fitted(_channels(bundle, layout, selection, parts), layout, fields, mix, sight)
    action = Channel(name="action", shape=(actions.shape[1],), names=first.episodes.joint_names)
    action = mix.fitted(action, actions)
    lengths = [len(episode.action) for episode in every]
    return Demonstrations(
        contract=PolicyContract(
            algorithm=algorithm,
            task=first.episodes.task,
            embodiment=first.episodes.embodiment,
            inputs=channels,
            action=action,
            rate_hz=first.episodes.rate_hz,
            dataset=_digest(parts),
            settings=dict(settings),
            views={name: shown.view for name, shown in layout.cameras.items() if shown.view is not None},
        ),
        inputs=features.Reader(channels, layout).read(fields),
        actions=features.normalised(action, actions),
        first=np.repeat(np.cumsum([0, *lengths[:-1]]), lengths),
        last=np.repeat(np.cumsum(lengths) - 1, lengths),
        train=train,
        held_out=held_out,
        train_rows=mix.rows,
        weights=mix.weights,
        held_out_rows=np.setdiff1d(np.arange(len(actions)), np.concatenate(mix.rows)),
        sight=sight,
        places=_places(bundle, layout, fields, mix) if first.films else None,
    )


@dataclass(frozen=True)
class _Mix:
    """Rows of the training episodes of each part, and the parts' weights."""

    rows: tuple[np.ndarray, ...]
    weights: tuple[int, ...]

    def fitted(self, channel: Channel, samples: np.ndarray) -> Channel:
        """The channel with the normalisation of its samples (N, ...), weighted as batches are."""
        return normalisation.fitted(channel, [samples[rows] for rows in self.rows], self.weights)


def _split(parts: Sequence[Part], selection: Selection) -> tuple[list[np.ndarray], tuple[str, ...], tuple[str, ...]]:
    """Rows of the training episodes of each part, and the names of the training and held out episodes."""
    rows, train, held_out, begun = list[np.ndarray](), list[str](), list[str](), 0
    for part in parts:
        names = tuple(part.episodes.items)
        kept, out = split(names, selection.held_out, selection.seed)
        chosen = np.repeat([name in kept for name in names], part.lengths)
        rows.append(begun + np.flatnonzero(chosen))
        begun += len(chosen)
        train += [part.named(name) for name in kept]
        held_out += [part.named(name) for name in out]
    return rows, tuple(train), tuple(held_out)


def split(names: tuple[str, ...], share: float, seed: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """(training, held out) episodes, in their order; at least one for training."""
    count = min(round(share * len(names)), len(names) - 1)
    drawn = set(np.random.default_rng([seed, 1]).permutation(len(names))[:count].tolist())
    return (
        tuple(name for number, name in enumerate(names) if number not in drawn),
        tuple(name for number, name in enumerate(names) if number in drawn),
    )


def _places(bundle: TaskBundle, layout: Layout, fields: features.Fields, mix: _Mix) -> np.ndarray:
    """Normalised pose and joints of the task's object, (N, P)."""
    name = bundle.task.object
    pose = contracts.channel(layout, "objects", (name,))
    joints = contracts.channel(layout, "displacement", bundle.objects[name].joints)
    reader = features.Reader((pose, joints), layout)
    encoded = [(one, reader.encoded(one, fields)) for one in (pose, joints)]
    parts = [features.normalised(mix.fitted(one, part), part) for one, part in encoded]
    return np.concatenate([part.reshape(len(part), -1) for part in parts], axis=1)


def _fitted(
    channels: tuple[Channel, ...], layout: Layout, fields: features.Fields, mix: _Mix, sight: Mapping[str, Sight]
) -> tuple[Channel, ...]:
    """The channels with the normalisation of the training rows; flags and pictures have none."""
    reader = features.Reader(channels, layout)

    def fitted(one: Channel) -> Channel:
        if one.encoding == "picture" or one.name == WORLD:
            return one
        if one.encoding in SEEN:
            shown = sight[cameras.camera_of(one.name)]
            seen = [shown.measured(one, rows[:: -(-len(rows) // FITTED)]) for rows in mix.rows]
            return normalisation.fitted(one, seen, mix.weights)
        return mix.fitted(one, reader.encoded(one, fields))

    return tuple(map(fitted, channels))


def _channels(bundle: TaskBundle, layout: Layout, selection: Selection, parts: Sequence[Part]) -> tuple[Channel, ...]:
    only: dict[str, tuple[str, ...]] = {WORLD: tuple(dict.fromkeys(part.episodes.world for part in parts))}
    if selection.objects == "task":
        names = concerned(bundle.task, bundle.objects)
        only |= {"objects": names, "displacement": tuple(j for name in names for j in bundle.objects[name].joints)}
    rows = {name: term.rows for name in selection.inputs if (term := layout.channel(name))} | {WORLD: WORLD}
    known = [name for name in (*contracts.VECTORS, WORLD, *layout.seen) if name in selection.inputs]
    added = [name for name in selection.inputs if name not in known]
    made = [contracts.channel(layout, name, only.get(rows.get(name, ""))) for name in (*known, *added)]
    made = [
        one.model_copy(update={"reach_m": selection.reach_m}) if one.encoding in ("depth", "cloud") else one
        for one in made
    ]
    found = tuple(one for one in made if one.shape[0])
    if not found:
        raise RuleError(
            f"none of the inputs has a component: {', '.join(selection.inputs)}", code="DXB-B516", hint="objects: all"
        )
    return found


def _digest(parts: Sequence[Part]) -> str:
    """The digest of the data set, and of the weights of a mixture."""
    if len(parts) == 1:
        return parts[0].digest()
    return digest.of_value([[part.label, part.weight, part.digest()] for part in parts])

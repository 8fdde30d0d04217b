"""Training data of imitation learning: normalised inputs and actions, split by episode."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from dextera_build import digest
from dextera_build.artifacts.tasks.episode import Episodes, Film
from dextera_build.artifacts.tasks.policy import Channel, PolicyContract
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.errors import RuleError
from dextera_build.policy import contract as contracts
from dextera_build.policy import features, normalisation
from dextera_build.policy.layout import Layout, of_bundle, of_episodes

Settings = Mapping[str, float | int | str | bool]


@dataclass(frozen=True)
class Selection:
    """The part of the recorded data that an algorithm learns from."""

    inputs: tuple[str, ...]
    """Input channels of the deployable observation."""
    objects: Literal["task", "all"] = "task"
    """Objects with poses and joints in the input: the task's object only, or all."""
    held_out: float = 0.0
    """Fraction of the episodes held out for validation."""
    seed: int = 0
    """Seed of the split."""


@dataclass(frozen=True)
class Demonstrations:
    """All steps of all episodes, one row each, in episode order."""

    contract: PolicyContract
    """Inputs and outputs of the policy, with the normalisation of the training episodes."""
    inputs: dict[str, np.ndarray]
    """Vector channel -> (N, tokens, features) float32, normalised."""
    actions: np.ndarray
    """Normalised joint targets before noise, (N, A) float32."""
    last: np.ndarray
    """Last row of each row's episode, (N,) int64."""
    train: tuple[str, ...]
    """Training episodes."""
    held_out: tuple[str, ...]
    """Validation episodes."""
    train_rows: np.ndarray
    """Rows of the training episodes, (n,) int64."""
    held_out_rows: np.ndarray
    """Rows of the validation episodes, (m,) int64."""
    frames: np.ndarray | None
    """Pictures (N, H, W, 3) uint8, or None."""
    places: np.ndarray | None
    """Normalised pose and joints of the task's object, (N, P) float32; None without images."""


def prepare(
    bundle: TaskBundle,
    episodes: Episodes,
    film: Film | None,
    selection: Selection,
    *,
    algorithm: str,
    settings: Settings,
) -> Demonstrations:
    """Check and normalise the data; the normalisation comes only from the training episodes.

    Args:
        bundle: The task.
        episodes: Its demonstrations.
        film: Their pictures, for the input `rgb`.
        selection: Inputs to learn from.
        algorithm: Name of the algorithm, for the contract.
        settings: Settings that the algorithm needs to run the policy, for the contract.

    Raises:
        RuleError: The data do not fit the task or the selection.
    """
    contracts.check_data(bundle, episodes)
    _check(episodes, film, selection)
    layout = of_episodes(episodes, of_bundle(bundle).goal, film)
    train, held_out = split(tuple(episodes.items), selection.held_out, selection.seed)
    lengths = [len(episode.action) for episode in episodes.items.values()]
    chosen = np.repeat([name in train for name in episodes.items], lengths)
    recorded = [features.recorded(episode) for episode in episodes.items.values()]
    fields = {name: np.concatenate([part[name] for part in recorded]) for name in recorded[0]}
    actions = np.concatenate([episode.action for episode in episodes.items.values()])
    channels = _fitted(_channels(bundle, layout, selection), layout, fields, chosen)
    action = Channel(name="action", shape=(actions.shape[1],), names=episodes.joint_names)
    action = normalisation.fitted(action, [actions[chosen]])
    rows = np.arange(len(actions))
    return Demonstrations(
        contract=PolicyContract(
            algorithm=algorithm,
            task=episodes.task,
            embodiment=episodes.embodiment,
            inputs=channels,
            action=action,
            rate_hz=episodes.rate_hz,
            dataset=_digest(episodes, film),
            settings=dict(settings),
        ),
        inputs=features.Reader(channels, layout).read(fields),
        actions=features.normalised(action, actions),
        last=np.repeat(np.cumsum(lengths) - 1, lengths),
        train=train,
        held_out=held_out,
        train_rows=rows[chosen],
        held_out_rows=rows[~chosen],
        frames=np.concatenate([film.pixels(name) for name in episodes.items]) if film else None,
        places=_places(bundle, layout, fields, chosen) if film else None,
    )


def split(names: tuple[str, ...], share: float, seed: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """(training, held out) episodes, in their order; at least one for training."""
    count = min(round(share * len(names)), len(names) - 1)
    drawn = set(np.random.default_rng([seed, 1]).permutation(len(names))[:count].tolist())
    return (
        tuple(name for number, name in enumerate(names) if number not in drawn),
        tuple(name for number, name in enumerate(names) if number in drawn),
    )


def _places(bundle: TaskBundle, layout: Layout, fields: features.Fields, chosen: np.ndarray) -> np.ndarray:
    """Normalised pose and joints of the task's object, (N, P)."""
    name = bundle.task.object
    pose = contracts.channel(layout, "objects", (name,))
    joints = contracts.channel(layout, "displacement", bundle.objects[name].joints)
    reader = features.Reader((pose, joints), layout)
    encoded = [(one, reader.encoded(one, fields)) for one in (pose, joints)]
    parts = [features.normalised(normalisation.fitted(one, [part[chosen]]), part) for one, part in encoded]
    return np.concatenate([part.reshape(len(part), -1) for part in parts], axis=1)


def _check(episodes: Episodes, film: Film | None, selection: Selection) -> None:
    if not episodes.items:
        raise RuleError(
            "no episode succeeded, so there is nothing to learn from",
            code="DXB-B516",
            facts={"attempts": episodes.attempts},
        )
    if film is None:
        return
    if "rgb" not in selection.inputs:
        raise RuleError(
            "a film is given, but `rgb` is not among the inputs", code="DXB-B516", hint="inputs: [joints, goal, rgb]"
        )
    lost = [name for name in episodes.items if name not in film.frames]
    if lost:
        raise RuleError(
            f"the film lacks {len(lost)} of {len(episodes.items)} episodes", code="DXB-B516", facts={"first": lost[0]}
        )
    for name, episode in episodes.items.items():
        steps = len(film.pixels(name))
        if steps != len(episode.action):
            raise RuleError(f"episode `{name}` has {len(episode.action)} steps, but {steps} frames", code="DXB-B516")


def _fitted(
    channels: tuple[Channel, ...], layout: Layout, fields: features.Fields, chosen: np.ndarray
) -> tuple[Channel, ...]:
    """The channels with the normalisation of the chosen rows."""
    reader = features.Reader(channels, layout)
    return tuple(
        normalisation.fitted(one, [reader.encoded(one, fields)[chosen]]) if one.encoding != "picture" else one
        for one in channels
    )


def _channels(bundle: TaskBundle, layout: Layout, selection: Selection) -> tuple[Channel, ...]:
    only: dict[str, tuple[str, ...]] = {}
    if selection.objects == "task":
        name = bundle.task.object
        only = {"objects": (name,), "displacement": bundle.objects[name].joints}
    rows = {name: term.rows for name in selection.inputs if (term := layout.channel(name))}
    known = [name for name in contracts.CHANNELS if name in selection.inputs]
    added = [name for name in selection.inputs if name not in known]
    made = [contracts.channel(layout, name, only.get(rows.get(name, ""))) for name in (*known, *added)]
    found = tuple(one for one in made if one.shape[0])
    if not found:
        raise RuleError(
            f"none of the inputs has a component: {', '.join(selection.inputs)}", code="DXB-B516", hint="objects: all"
        )
    return found


def _digest(episodes: Episodes, film: Film | None) -> str:
    """The digest of the data set."""
    return digest.of_value([episodes.encode(digest.of_bytes), film.encode(digest.of_bytes) if film else None])

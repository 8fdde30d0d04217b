"""Training data of imitation learning: normalised inputs and actions, split by episode."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dextera_build import digest
from dextera_build.artifacts.episode import Episodes, Film
from dextera_build.artifacts.policy import Channel, PolicyContract
from dextera_build.artifacts.task import TaskBundle
from dextera_build.policy import contract as contracts
from dextera_build.policy import features, normalisation
from dextera_build.policy.layout import Layout, of_bundle, of_episodes
from dextera_build.rule import Context

if TYPE_CHECKING:
    from .act_options import ActOptions

SETTINGS = ("chunk", "width", "heads", "style_layers", "encoder_layers", "decoder_layers", "latent", "every", "forget")
"""Options that define the network and its use at run time; stored in the contract."""


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
    ctx: Context, bundle: TaskBundle, episodes: Episodes, film: Film | None, options: ActOptions
) -> Demonstrations:
    """Check and normalise the data; the normalisation comes only from the training episodes."""
    _check(ctx, episodes, film, options)
    layout = of_episodes(episodes, of_bundle(bundle).goal, film)
    train, held_out = split(tuple(episodes.items), options.held_out, options.seed)
    lengths = [len(episode.action) for episode in episodes.items.values()]
    chosen = np.repeat([name in train for name in episodes.items], lengths)
    recorded = [features.recorded(episode) for episode in episodes.items.values()]
    fields = {name: np.concatenate([part[name] for part in recorded]) for name in recorded[0]}
    actions = np.concatenate([episode.action for episode in episodes.items.values()])
    channels = _channels(bundle, layout, options)
    if not channels:
        ctx.fail(f"none of the inputs has a component: {', '.join(options.inputs)}", hint="objects: all")
    reader = features.Reader(channels, layout)
    channels = tuple(
        normalisation.fitted(one, [reader.encoded(one, fields)[chosen]]) if one.encoding != "picture" else one
        for one in channels
    )
    action = Channel(name="action", shape=(actions.shape[1],), names=episodes.joint_names)
    action = normalisation.fitted(action, [actions[chosen]])
    rows = np.arange(len(actions))
    places = _places(bundle, layout, fields, chosen) if film else None
    return Demonstrations(
        contract=_contract(episodes, film, channels, action, options, 0 if places is None else places.shape[1]),
        inputs=features.Reader(channels, layout).read(fields),
        actions=features.normalised(action, actions),
        last=np.repeat(np.cumsum(lengths) - 1, lengths),
        train=train,
        held_out=held_out,
        train_rows=rows[chosen],
        held_out_rows=rows[~chosen],
        frames=np.concatenate([film.pixels(name) for name in episodes.items]) if film else None,
        places=places,
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


def _check(ctx: Context, episodes: Episodes, film: Film | None, options: ActOptions) -> None:
    if not episodes.items:
        ctx.fail("no episode succeeded, so there is nothing to learn from", attempts=episodes.attempts)
    if film is None:
        return
    if "rgb" not in options.inputs:
        ctx.fail("a film is given, but `rgb` is not among the inputs", hint="inputs: [joints, goal, rgb]")
    lost = [name for name in episodes.items if name not in film.frames]
    if lost:
        ctx.fail(f"the film lacks {len(lost)} of {len(episodes.items)} episodes", first=lost[0])
    for name, episode in episodes.items.items():
        steps = len(film.pixels(name))
        if steps != len(episode.action):
            ctx.fail(f"episode `{name}` has {len(episode.action)} steps, but {steps} frames")


def _channels(bundle: TaskBundle, layout: Layout, options: ActOptions) -> tuple[Channel, ...]:
    only: dict[str, tuple[str, ...]] = {}
    if options.objects == "task":
        name = bundle.task.object
        only = {"objects": (name,), "displacement": bundle.objects[name].joints}
    made = [contracts.channel(layout, name, only.get(name)) for name in contracts.CHANNELS if name in options.inputs]
    return tuple(one for one in made if one.shape[0])


def _contract(
    episodes: Episodes,
    film: Film | None,
    inputs: tuple[Channel, ...],
    action: Channel,
    options: ActOptions,
    located: int,
) -> PolicyContract:
    parts = [episodes.encode(digest.of_bytes), film.encode(digest.of_bytes) if film else None]
    return PolicyContract(
        algorithm="act",
        task=episodes.task,
        embodiment=episodes.embodiment,
        inputs=inputs,
        action=action,
        rate_hz=episodes.rate_hz,
        dataset=digest.of_value(parts),
        settings={name: getattr(options, name) for name in SETTINGS} | {"located": located},
    )

"""Conversion of observation fields to the inputs of networks, shared by training and execution.

`recorded` reads the fields from an episode, `observed` from a live observation; a `Reader` converts either to inputs.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.tasks.episode import Episode
from dextera_build.artifacts.tasks.policy import Channel
from dextera_build.policy.declared import HIDDEN
from dextera_build.policy.layout import Layout

if TYPE_CHECKING:
    from dextera_build.policy.observation import DeployableObservation

Fields = dict[str, np.ndarray]
"""Term of the deployable observation -> its samples, stacked along the first axis."""


def recorded(episode: Episode) -> Fields:
    """Observations at each of the T steps of an episode, without pictures.

    Returns:
        `joints`, `previous_action` (T, A) [rad]; `objects` (T, O, 7); `displacement` (T, K); `goal` (T, G); and the
        terms that do not come with dxb.
    """
    steps = len(episode.action)
    sent = np.concatenate([episode.start.ctrl[None].astype(np.float32), episode.executed])[:steps]
    goal = np.broadcast_to(episode.goal, (steps, len(episode.goal)))
    shown = {name: values for name, values in episode.terms.items() if name not in HIDDEN}
    return {**shown, "previous_action": sent, "goal": goal}


def observed(observation: DeployableObservation) -> Fields:
    """One live observation as a stack of one sample."""
    fields = dict(observation.values)
    if observation.rgb is not None:
        fields["rgb"] = observation.rgb
    return {name: np.asarray(field)[None] for name, field in fields.items()}


class Reader:
    """Reads the vector inputs of a policy from observation fields.

    Components are selected by name, so that a world may have objects that are unknown to the policy.

    Args:
        channels: Inputs of the policy; pictures are ignored.
        layout: Layout of the source of the fields.
    """

    def __init__(self, channels: tuple[Channel, ...], layout: Layout) -> None:
        self._channels = [channel for channel in channels if channel.encoding != "picture"]
        self._rows = {
            channel.name: [(layout.names(channel.name) or ()).index(name) for name in channel.names]
            for channel in self._channels
        }

    def read(self, fields: Mapping[str, np.ndarray]) -> Fields:
        """Encoded and normalised inputs, float32 (N, tokens, features) each.

        Each row of a channel with components, such as an object, is one token; every other channel is one token.
        """
        return {channel.name: normalised(channel, self.encoded(channel, fields)) for channel in self._channels}

    def encoded(self, channel: Channel, fields: Mapping[str, np.ndarray]) -> np.ndarray:
        """One channel before normalisation, float32 (N, tokens, features)."""
        picked = fields[channel.name][:, self._rows[channel.name]].astype(np.float32)
        if channel.encoding == "pose":
            return np.concatenate([picked[..., :3], rotation_columns(picked[..., 3:])], axis=-1)
        return picked if picked.ndim == 3 else picked[:, None, :]


def tokens(channel: Channel) -> tuple[int, int]:
    """(tokens, features per token) of a vector channel."""
    if channel.encoding == "pose":
        return channel.shape[0], 9
    return (channel.shape[0], channel.shape[1]) if len(channel.shape) == 2 else (1, channel.shape[0])


def normalised(channel: Channel, samples: np.ndarray) -> np.ndarray:
    """(N, tokens, features) minus the channel's mean, divided by its scale."""
    if not channel.scale:
        return samples
    shape = samples.shape[1:]
    mean, scale = (np.array(part, np.float32).reshape(shape) for part in (channel.mean, channel.scale))
    return np.asarray((samples - mean) / scale)


def rotation_columns(quaternions: np.ndarray) -> np.ndarray:
    """(..., 6): the first two columns of the rotations of (..., 4) quaternions w x y z; the same for q and -q."""
    unit = quaternions / np.maximum(np.linalg.norm(quaternions, axis=-1, keepdims=True), 1e-9)
    w, x, y, z = np.moveaxis(unit, -1, 0)
    first = (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y))
    second = (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x))
    return np.stack([*first, *second], axis=-1)

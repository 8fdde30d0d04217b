"""Conversion of observation fields to the inputs of networks, shared by training and execution.

`recorded` reads the fields from an episode, `observed` from a live observation; a `Reader` converts either to inputs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.tasks.episode import DEPTH_STEP_M, Episode
from dextera_build.artifacts.tasks.policy import SEEN, Channel
from dextera_build.policy import cameras
from dextera_build.policy.cameras import PICTURE
from dextera_build.policy.declared import HIDDEN
from dextera_build.policy.layout import Layout

if TYPE_CHECKING:
    from dextera_build.policy.observation import DeployableObservation

POINTS = 512
"""Most points of a cloud that a network sees."""
FARTHEST = 65_535
"""Count that means that nothing was measured, by ROS's REP 118."""
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
    """One live observation as a stack of one sample.

    A policy with one camera gets the frame of the first one, whatever its name is.
    """
    fields, frames = dict(observation.values), dict(observation.frames)
    if frames:
        frames.setdefault(PICTURE, next(iter(frames.values())))
    for camera, frame in frames.items():
        shown = {term: getattr(frame, term) for term in cameras.TERMS}
        fields |= {cameras.channel_of(term, camera): each for term, each in shown.items() if each is not None}
    return {name: np.asarray(field)[None] for name, field in fields.items()}


class Reader:
    """Reads the vector inputs of a policy from observation fields.

    Components are selected by name, so that a world may have objects that are unknown to the policy.

    Args:
        channels: Inputs of the policy; those that a camera gives are ignored.
        layout: Layout of the source of the fields.
    """

    def __init__(self, channels: tuple[Channel, ...], layout: Layout) -> None:
        self._channels = [channel for channel in channels if channel.encoding not in SEEN]
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


def counts(depth: np.ndarray) -> np.ndarray:
    """Distances [m] as uint16 counts of `DEPTH_STEP_M`, as films hold them; 0 where they are no number or too far."""
    steps = np.nan_to_num(np.round(np.asarray(depth, np.float64) / DEPTH_STEP_M), nan=0.0, posinf=0.0, neginf=0.0)
    return np.where((steps > 0) & (steps < FARTHEST), steps, 0).astype(np.uint16)


def measured(channel: Channel, samples: np.ndarray) -> np.ndarray:
    """Input of a network from the depth or the points of a camera; of points those of `even` pixels.

    Args:
        channel: The channel; without a normalisation, samples are passed on.
        samples: `depth` (N, H, W) or `cloud` (N, H, W, 3) [m], 0 where nothing was measured.

    Returns:
        As `ranged`.
    """
    if not channel.scale:
        return samples
    if channel.encoding == "cloud":
        rows, columns = even(samples.shape[1], samples.shape[2])
        samples = samples[:, rows, columns]
    return ranged(channel, samples)


def near(channel: Channel, distances: np.ndarray) -> np.ndarray:
    """Whether distances [m] are within the reach of a channel of depth or points."""
    return np.asarray(distances <= (channel.reach_m or np.inf))


def even(height: int, width: int) -> tuple[slice, slice]:
    """Rows and columns of an even grid of at most `POINTS` pixels."""
    apart = math.ceil(math.sqrt(height * width / POINTS))
    return slice(apart // 2, None, apart), slice(apart // 2, None, apart)


def ranged(channel: Channel, samples: np.ndarray) -> np.ndarray:
    """Distances (N, H, W) or points (N, H, W, 3) [m], rounded to millimetres of distance and normalised.

    Returns:
        (N, H, W, 2) or (N, H, W, 4) float32: normalised numbers, then 1 where they were measured, else all 0.
    """
    values = samples[..., None] if channel.encoding == "depth" else samples
    far = counts(values[..., -1:])
    exact = values[..., -1:]
    known = (far > 0) & near(channel, exact)
    # The points of a pixel are on its ray, and move with its distance.
    rounded = values * np.divide(far * DEPTH_STEP_M, exact, out=np.zeros(exact.shape), where=known)
    mean, scale = (np.array(part, np.float32) for part in (channel.mean, channel.scale))
    return np.concatenate([np.where(known, (rounded - mean) / scale, 0.0), known], axis=-1).astype(np.float32)


def rotation_columns(quaternions: np.ndarray) -> np.ndarray:
    """(..., 6): the first two columns of the rotations of (..., 4) quaternions w x y z; the same for q and -q."""
    unit = quaternions / np.maximum(np.linalg.norm(quaternions, axis=-1, keepdims=True), 1e-9)
    w, x, y, z = np.moveaxis(unit, -1, 0)
    first = (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y))
    second = (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x))
    return np.stack([*first, *second], axis=-1)

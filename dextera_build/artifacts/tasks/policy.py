"""Trained policies: weights, and the contract that decides whether they may run in a world."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from dextera_build.artifacts.base import Array, Artifact, Value

Encoding = Literal["plain", "pose", "picture", "depth", "cloud"]
"""`plain`: unchanged numbers. `pose`: position and the first two columns of the rotation matrix (Zhou et al.
2019) instead of position and quaternion, because q and -q are one rotation. `picture`: 0 to 255 is mapped to -1 to
1. `depth` and `cloud`: distances and points [m], each with 1 where it was measured, else all 0."""
SEEN: tuple[Encoding, ...] = ("picture", "depth", "cloud")
"""Encodings of what a camera gives."""


class Channel(Value):
    """One input of a policy, or its output."""

    name: str
    """Term of the deployable observation: `joints`, `objects`, ..., `rgb`, `depth`, or one that a project adds."""
    shape: tuple[int, ...]
    """Shape of one observed sample, before encoding."""
    names: tuple[str, ...] = ()
    """Names of the components along the first axis, in order; components of an input are selected by name."""
    encoding: Encoding = "plain"
    """Encoding of a sample for the network."""
    mean: tuple[float, ...] = ()
    """Subtracted from the flattened encoded sample, per component; empty: nothing."""
    scale: tuple[float, ...] = ()
    """Divisor after the subtraction, per component; empty: none."""
    reach_m: float | None = None
    """Distance above which depth and points count as not measured [m]; None: there is no limit."""


class ViewSpec(Value):
    """A camera, in numbers."""

    size_px: tuple[int, int]
    """Width and height of a frame [px]."""
    focal_px: tuple[float, float]
    """Focal lengths along x and y [px]."""
    centre_px: tuple[float, float]
    """Principal point, x and y [px]."""
    position_m: tuple[float, float, float]
    """Of T_world_camera [m]."""
    quaternion: tuple[float, float, float, float]
    """Of T_world_camera, w x y z, OpenCV axes."""
    sigma_m: float = 0.0
    """Standard deviation of the position by the camera's calibration [m]; 0: exact, or not stated."""
    sigma_rad: float = 0.0
    """Standard deviation of the rotation [rad]."""


class PolicyContract(Value):
    """The inputs and outputs of a policy. A policy is refused if one of them differs."""

    algorithm: str
    """Training algorithm: the folder of its rule, `act` of `rules/learn/act/`, whose `policy.py` runs the weights."""
    task: str
    """Name of the task."""
    embodiment: str
    """Digest of joint names and limits."""
    inputs: tuple[Channel, ...]
    """Observation channels, in order."""
    action: Channel
    """Joint targets [rad] by joint name, in order, and their normalisation."""
    rate_hz: float
    """Control rate [Hz]."""
    dataset: str
    """Digest of the data set, or of the task bundle for reinforcement learning."""
    settings: dict[str, float | int | str | bool]
    """Sizes of the network."""
    views: dict[str, ViewSpec] = Field(default_factory=dict)
    """Camera -> the one that filmed the data set; a camera that is missing was not stated, and may be any."""

    @property
    def seen(self) -> tuple[Channel, ...]:
        """Inputs that a camera gives: `rgb`, `depth`, `cloud`."""
        return tuple(channel for channel in self.inputs if channel.encoding in SEEN)

    @property
    def vectors(self) -> tuple[Channel, ...]:
        """The other inputs, which are numbers."""
        return tuple(channel for channel in self.inputs if channel.encoding not in SEEN)

    @property
    def sees(self) -> bool:
        """Whether the policy takes pictures, depth or points."""
        return bool(self.seen)

    @property
    def history(self) -> int:
        """Number of steps that the policy sees at once, the present one last."""
        return int(self.settings.get("history", 1))


class EarlyTrials(Value):
    """How often the snapshots of a training succeeded, each from the same starts."""

    steps: tuple[int, ...]
    """Optimiser step of each snapshot, ascending; the last is the end of the training."""
    successes: tuple[int, ...]
    """Successful trials of each snapshot."""
    progress: tuple[float, ...]
    """Mean fraction of the stages of the task that the trials of each snapshot reached."""
    trials: int
    """Trials of each snapshot."""
    chosen: int
    """Step of the snapshot whose weights the checkpoint has."""


class Checkpoint(Artifact):
    """A trained policy."""

    weights: bytes
    """safetensors; never a pickle."""
    contract: PolicyContract
    """Required inputs, outputs and embodiment."""
    steps: Annotated[np.ndarray, Array("L", "int64")]
    """Optimiser steps (imitation) or environment steps (reinforcement) of `curve`."""
    curve: Annotated[np.ndarray, Array("L", "float32")]
    """Training loss (imitation) or mean episode reward (reinforcement) at `steps`."""
    curve_name: str
    """Name of the quantity in `curve`."""
    snapshots: dict[str, bytes] = Field(default_factory=dict)
    """Optimiser step -> the weights after it, as `weights`; only those that the training was asked to keep."""
    early: EarlyTrials | None = None
    """Trials of the snapshots, if there were any; none of them counts in a reported success."""

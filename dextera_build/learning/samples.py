"""Training samples: windows of steps around a row of the demonstrations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from dextera_build.policy import cameras

if TYPE_CHECKING:
    from dextera_build.learning.demonstrations import Demonstrations


@dataclass(frozen=True)
class Window:
    """Steps of a sample, relative to its row: `range(-1, 1)` is the step before and the present one."""

    acted: range
    """Steps whose actions a sample holds."""
    observed: range = range(1)
    """Steps whose observations a sample holds."""


@dataclass(frozen=True)
class Batch:
    """Training samples. Steps before the first of an episode repeat it, those after the last repeat that."""

    inputs: Mapping[str, Tensor]
    """Channel -> (B, tokens, features) float32, normalised; those of a camera as `as_seen` gives them. With several
    observed steps T the axis after B is T."""
    actions: Tensor
    """Demonstrated actions (B, C, A), normalised."""
    keep: Tensor
    """(B, C), false for steps outside the episode."""
    places: Tensor | None = None
    """(B, P) normalised pose and joints of the task's object at the row: auxiliary target of image policies, in
    training only."""


@dataclass
class Samples:
    """The demonstrations as tensors, from which batches are taken."""

    data: Demonstrations
    window: Window
    device: str = "cpu"
    inputs: dict[str, Tensor] = field(init=False)
    """Vector channel -> (N, tokens, features)."""

    def __post_init__(self) -> None:
        data = self.data
        self.inputs = {name: torch.from_numpy(each).to(self.device) for name, each in data.inputs.items()}
        self._actions = torch.from_numpy(data.actions).to(self.device)
        self._first, self._last = torch.from_numpy(data.first), torch.from_numpy(data.last)
        self._places = torch.from_numpy(data.places).to(self.device) if data.places is not None else None

    def at(self, rows: np.ndarray) -> Batch:
        """The samples of rows (B,) int64."""
        chosen = torch.from_numpy(rows)
        seen, _ = self._steps(chosen, self.window.observed)
        acted, keep = self._steps(chosen, self.window.acted)
        seen = seen[:, 0] if len(self.window.observed) == 1 else seen
        inputs = {name: each[seen.to(self.device)] for name, each in self.inputs.items()}
        for channel in self.data.contract.seen:
            sight = self.data.sight[cameras.camera_of(channel.name)]
            frames = torch.from_numpy(sight.at(channel, seen.flatten().numpy())).to(self.device)
            inputs[channel.name] = as_seen(channel.name, frames.view(*seen.shape, *frames.shape[1:]))
        places = self._places[chosen.to(self.device)] if self._places is not None else None
        return Batch(inputs, self._actions[acted.to(self.device)], keep.to(self.device), places)

    def foreground(self, rows: np.ndarray) -> dict[str, Tensor]:
        """Channel of pictures with other backgrounds -> pixels (N, H, W) bool of robot and objects.

        N are the observed steps of rows (B,) int64, one sample after another.
        """
        seen, _ = self._steps(torch.from_numpy(rows), self.window.observed)
        found = {}
        for channel in self.data.contract.seen:
            sight = self.data.sight[cameras.camera_of(channel.name)]
            if channel.encoding == "picture" and sight.masks is not None:
                masks = torch.from_numpy(sight.foreground(seen.flatten().numpy()))
                found[channel.name] = masks.to(self.device)
        return found

    def _steps(self, rows: Tensor, window: range) -> tuple[Tensor, Tensor]:
        """Rows (B, T) of the steps of a window, within the episode, and whether each was."""
        found = rows[:, None] + torch.arange(window.start, window.stop)
        first, last = self._first[rows][:, None], self._last[rows][:, None]
        return found.clamp(first, last), (found >= first) & (found <= last)


def as_seen(name: str, frames: Tensor) -> Tensor:
    """A channel of a camera as networks take it.

    Args:
        name: `rgb`, `depth` or `cloud`, of any camera.
        frames: (..., H, W, 3) uint8, (..., H, W, 2) or (..., H, W, 4) float32.

    Returns:
        `rgb` (..., 3, H, W) in -1 to 1, `depth` (..., 2, H, W), `cloud` (..., H, W, 4) unchanged.
    """
    term = cameras.term_of(name)
    if term == "cloud":
        return frames
    planes = frames.movedim(-1, -3)
    return planes.to(torch.float32).div_(127.5).sub_(1.0) if term == "rgb" else planes

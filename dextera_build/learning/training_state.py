"""The state of a training on disk, for resuming after an interruption."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path

import torch
from torch import nn
from torch.optim.swa_utils import AveragedModel

from dextera_build.learning import kept_state


@dataclass
class Kept:
    """Training state in addition to weights and moments."""

    of: str
    """Digest of data and options; a state with another digest is ignored."""
    step: int = 0
    """Completed steps."""
    sum: float = 0.0
    """Loss summed since the last point of the curve."""
    steps: list[int] = field(default_factory=list)
    """Steps of `curve`."""
    curve: list[float] = field(default_factory=list)
    """Mean training loss between points."""
    held_steps: list[int] = field(default_factory=list)
    """Steps of `held_curve`."""
    held_curve: list[float] = field(default_factory=list)
    """Loss of held-out episodes."""
    error_rad: float = 0.0
    """Latest error of held-out episodes [rad]."""


def save(
    file: Path, kept: Kept, network: nn.Module, optimiser: torch.optim.Optimizer, average: AveragedModel | None = None
) -> None:
    """Write the state to one file atomically."""
    tensors = {f"weight.{name}": tensor for name, tensor in network.state_dict().items()}
    if average is not None:
        tensors |= {f"average.{name}": tensor for name, tensor in average.state_dict().items()}
    kept_state.write(file, tensors | kept_state.moments(optimiser), asdict(kept))


def restore(
    file: Path,
    kept: Kept,
    network: nn.Module,
    optimiser: torch.optim.Optimizer,
    average: AveragedModel | None = None,
    usable: Callable[[int], bool] = lambda step: True,
) -> bool:
    """Restore a saved state of the same training; return whether there was one.

    Args:
        file: The file.
        kept: Receives what is saved.
        network: Receives the weights.
        optimiser: Receives the moments.
        average: Receives the moving average.
        usable: Whether a state after so many steps can be used.
    """
    found = kept_state.read(file)
    if found is None or found[0].get("of") != kept.of or not usable(int(str(found[0].get("step")))):
        return False
    notes, tensors = found
    network.load_state_dict(kept_state.under(tensors, "weight."))
    if average is not None:
        average.load_state_dict(kept_state.under(tensors, "average."))
    kept_state.take_moments(optimiser, tensors)
    for name, value in notes.items():
        setattr(kept, name, value)
    return True

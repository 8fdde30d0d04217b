"""Options of learn.lerobot."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from dextera_build.rule import Options


class LerobotOptions(Options):
    """Options of learn.lerobot."""

    type: str = "act"
    """Kind of policy, as LeRobot names it: `act`, `diffusion`, `vqbet`, `smolvla`, `pi05`, ..."""
    policy: dict[str, Any] = Field(default_factory=dict)
    """Fields of LeRobot's configuration of that kind, `{chunk_size: 20, n_action_steps: 20}`; others have its
    defaults."""
    trainer: dict[str, Any] = Field(default_factory=dict)
    """Further arguments of LeRobot's trainer, `{dataset.image_transforms.enable: true}`."""
    steps: int = Field(100_000, ge=1)
    """Optimiser steps."""
    batch: int = Field(8, ge=1)
    """Samples per step."""
    workers: int = Field(2, ge=0, le=64)
    """Processes that read the data set."""
    save_every: int = Field(2000, ge=1)
    """Steps between the trainer's checkpoints, from the last of which an interrupted training goes on."""
    seed: int = Field(1000, ge=0)
    """Seed of initial weights and order, and of the noise at run time."""
    least_range_rad: float = Field(0.01, gt=0.0)
    """Least range of a joint, an action or another number in the statistics by which LeRobot scales it, and four times
    the least standard deviation [rad or m]; without one, a finger that hardly moves is amplified."""

"""Options of learn.act."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, NonNegativeFloat, model_validator

from dextera_build.policy import contract as contracts
from dextera_build.rule import Options


class ActOptions(Options):
    """Options of learn.act."""

    inputs: tuple[str, ...] = ("joints", "objects", "displacement", "goal")
    """Input channels of the deployable observation; add `rgb` if a film is given, and `world` to tell the policy which
    kind of world a sample of a mixture is from."""
    objects: Literal["task", "all"] = "task"
    """Objects with poses and joints in the input: the task's object only, or all. Irrelevant objects can only
    mislead a policy trained on a hundred episodes."""
    chunk: int = Field(20, ge=1, le=200)
    """Steps predicted at once."""
    width: int = Field(96, ge=8)
    """Features of a token."""
    heads: int = Field(4, ge=1)
    """Attention heads; a divisor of `width`."""
    style_layers: int = Field(1, ge=1)
    """Blocks of the style encoder."""
    encoder_layers: int = Field(2, ge=1)
    """Blocks over the observation's tokens."""
    decoder_layers: int = Field(2, ge=1)
    """Blocks over the chunk's tokens."""
    latent: int = Field(8, ge=1)
    """Size of the latent style."""
    kl_weight: float = Field(10.0, ge=0.0)
    """Weight of the style's divergence from a normal distribution."""
    steps: int = Field(3000, ge=1)
    """Optimiser steps."""
    batch: int = Field(64, ge=1)
    """Samples per step."""
    rate: float = Field(1e-3, gt=0.0)
    """Peak learning rate of AdamW, with cosine decay to 0."""
    decay: float = Field(1e-4, ge=0.0)
    """Weight decay of AdamW."""
    jitter: float = Field(0.0, ge=0.0)
    """Noise added to inputs in training, in their standard deviations."""
    shift: int = Field(0, ge=0)
    """Maximum random shift of images in training [px]; with a fixed camera, shifts lose position information."""
    held_out: float = Field(0.1, ge=0.0, lt=1.0)
    """Fraction of the episodes held out for validation."""
    every: int = Field(1, ge=1)
    """Steps between predictions of a new chunk at run time."""
    forget: NonNegativeFloat = 0.01
    """Weights exp(-forget * i), i = 0 for the oldest, for averaging overlapping chunks at run time."""
    seed: int = Field(0, ge=0)
    """Seed of initial weights, order, noise and split."""

    @model_validator(mode="after")
    def _deployable(self) -> ActOptions:
        contracts.check_inputs(self.inputs)
        return self

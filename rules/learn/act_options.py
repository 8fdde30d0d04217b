"""Options of learn.act."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, NonNegativeFloat

from dextera_build.rule import Options


class ActOptions(Options):
    """Options of learn.act."""

    inputs: tuple[str, ...] = ("joints", "objects", "displacement", "goal")
    """Channels of the deployable observation that the policy gets; `rgb` where a film is given."""
    objects: Literal["task", "all"] = "task"
    """Whose poses and joints it gets: those of the task's object, or of every object. What does not matter to the task
    can only mislead a policy that learns from a hundred episodes."""
    chunk: int = Field(20, ge=1, le=200)
    """Steps that are predicted at once."""
    width: int = Field(96, ge=8)
    """Features of a token."""
    heads: int = Field(4, ge=1)
    """Attention heads; they divide `width`."""
    style_layers: int = Field(1, ge=1)
    """Blocks of the style encoder."""
    encoder_layers: int = Field(2, ge=1)
    """Blocks over the observation's tokens."""
    decoder_layers: int = Field(2, ge=1)
    """Blocks over the chunk's tokens."""
    latent: int = Field(8, ge=1)
    """Size of the style."""
    kl_weight: float = Field(10.0, ge=0.0)
    """Weight of the style's divergence from a normal distribution."""
    steps: int = Field(3000, ge=1)
    """Optimiser steps."""
    batch: int = Field(64, ge=1)
    """Samples per step."""
    rate: float = Field(1e-3, gt=0.0)
    """Learning rate of AdamW at its highest; it falls to 0 along a cosine."""
    decay: float = Field(1e-4, ge=0.0)
    """Weight decay of AdamW."""
    jitter: float = Field(0.0, ge=0.0)
    """Noise that is added to inputs in training, in their standard deviations."""
    shift: int = Field(0, ge=0)
    """Pictures are moved by up to this many pixels in training; through a camera that stands still, places are lost."""
    held_out: float = Field(0.1, ge=0.0, lt=1.0)
    """Share of the episodes that is not trained on, but only measured with."""
    every: int = Field(1, ge=1)
    """At run time a new chunk is asked for after this many steps."""
    forget: NonNegativeFloat = 0.01
    """At run time overlapping chunks are averaged with weights exp(-forget * i), i = 0 for the oldest."""
    seed: int = Field(0, ge=0)
    """Seed of first weights, order, noise and split."""

"""Options of learn.act."""

from __future__ import annotations

from pydantic import Field, NonNegativeFloat

from dextera_build.learning.options import ImitationOptions


class ActOptions(ImitationOptions):
    """Options of learn.act."""

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
    feed_forward: int = Field(0, ge=0)
    """Features between the two layers of a block's perceptron; 0: twice the width."""
    dropout: float = Field(0.0, ge=0.0, lt=1.0)
    """Share of the features of a block that are left out in training."""
    kl_weight: float = Field(10.0, ge=0.0)
    """Weight of the style's divergence from a normal distribution."""
    every: int = Field(1, ge=1)
    """Steps between predictions of a new chunk at run time."""
    forget: NonNegativeFloat = 0.01
    """Weights exp(-forget * i), i = 0 for the oldest, for averaging overlapping chunks at run time."""

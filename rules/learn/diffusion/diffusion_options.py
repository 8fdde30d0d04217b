"""Options of learn.diffusion."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from dextera_build.learning.options import ImitationOptions


class DiffusionOptions(ImitationOptions):
    """Options of learn.diffusion; the defaults train on states on a CPU."""

    network: Literal["unet", "transformer"] = "unet"
    """The network: convolutions over time, or attention."""
    horizon: int = Field(16, ge=2, le=200)
    """Steps of the predicted window, which begins at the oldest observed step; for `unet` a multiple of
    2^(levels - 1)."""
    history: int = Field(2, ge=1, le=16)
    """Observed steps, the present one last."""
    every: int = Field(8, ge=1)
    """Predicted steps that are executed, from the present one, before the next prediction."""
    width: int = Field(64, ge=8, multiple_of=8)
    """Features of the first level of `unet`, which double with each level; features of a token of `transformer`."""
    levels: int = Field(3, ge=1, le=6)
    """Levels of `unet`; each halves the length of the window."""
    layers: int = Field(4, ge=1)
    """Blocks of `transformer`."""
    heads: int = Field(4, ge=1)
    """Attention heads of `transformer`; a divisor of `width`."""
    dropout: float = Field(0.0, ge=0.0, lt=1.0)
    """Dropout of `transformer` in training."""
    predicts: Literal["sample", "noise"] = "sample"
    """What the network tells of a mixed window: the actions without the noise, which a few thousand steps of training
    suffice for, or the noise, as Chi et al. do in a hundred times as many: where nearly all is noise, a small error of
    it is a large one of the actions."""
    noise_levels: int = Field(100, ge=2, le=1000)
    """Levels of noise in training."""
    denoisings: int = Field(10, ge=1)
    """Passes of the network for one prediction, at evenly spaced levels of noise."""
    rate: float = Field(1e-3, gt=0.0)
    """Peak learning rate of AdamW, with cosine decay to 0."""
    warm_up: int = Field(500, ge=1)
    """Steps of linear warm-up of the learning rate."""
    decay: float = Field(1e-6, ge=0.0)
    """Weight decay of AdamW."""
    average: float = Field(0.9999, ge=0.0, lt=1.0)
    """Greatest decay of the moving average of the weights, which is what the checkpoint holds (EMA); 0: no average."""

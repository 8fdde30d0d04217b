"""Options of learn.openvla."""

from __future__ import annotations

from pydantic import Field

from dextera_build.rule import Options


class OpenvlaOptions(Options):
    """Options of learn.openvla; the defaults are those of OpenVLA's `finetune.py`."""

    base: str = ""
    """Folder of the base model on the machine that trains, `~/models/openvla-7b`. Its digest is in the checkpoint."""
    steps: int = Field(50_000, ge=1)
    """Optimiser steps."""
    batch: int = Field(16, ge=1)
    """Samples per step and GPU."""
    accumulate: int = Field(1, ge=1)
    """Batches whose gradients are added up to one step."""
    rate: float = Field(5e-4, gt=0.0)
    """Learning rate."""
    rank: int = Field(32, ge=1)
    """Rank of the adapters (LoRA)."""
    dropout: float = Field(0.0, ge=0.0, lt=1.0)
    """Dropout of the adapters."""
    augment: bool = True
    """Crop pictures and vary their colours in training."""
    quantise: bool = False
    """Hold the base model in 4 bits, which needs less memory and costs success."""
    shuffle: int = Field(100_000, ge=1)
    """Samples in the buffer that is drawn from; fewer need less memory."""
    least_range_rad: float = Field(0.01, gt=0.0)
    """Least distance of the quantiles q01 and q99 of an action, by which it is scaled [rad or m]; without one, a finger
    that hardly moves is amplified."""

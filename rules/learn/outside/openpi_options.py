"""Options of learn.openpi."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from dextera_build.rule import Options


class OpenpiOptions(Options):
    """Options of learn.openpi."""

    base: str = ""
    """Folder with the weights to begin with on the machine that trains, `~/models/pi05_base/params`. Its digest is in
    the checkpoint."""
    model: Literal["pi05", "pi0"] = "pi05"
    """Model of the base."""
    adapters: bool = True
    """Train adapters (LoRA) beside frozen weights, which needs less memory than to train all weights."""
    horizon: int = Field(50, ge=1, le=200)
    """Steps of an answer."""
    relative: bool = True
    """Learn actions as differences from the joints at the first step of an answer."""
    steps: int = Field(30_000, ge=1)
    """Optimiser steps."""
    batch: int = Field(32, ge=1)
    """Samples per step."""
    workers: int = Field(2, ge=0, le=64)
    """Processes that read the data set."""
    save_every: int = Field(1000, ge=1)
    """Steps between the trainer's checkpoints, from the last of which an interrupted training goes on."""
    seed: int = Field(42, ge=0)
    """Seed of initial adapters and order."""
    least_range_rad: float = Field(0.01, gt=0.0)
    """Least distance of the quantiles q01 and q99 of a joint or an action, by which it is scaled [rad or m]; without
    one, a finger that hardly moves is amplified."""

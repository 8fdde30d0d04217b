"""Options of learn.bc_rnn."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from dextera_build.learning.options import ImitationOptions


class BcRnnOptions(ImitationOptions):
    """Options of learn.bc_rnn."""

    horizon: int = Field(10, ge=1, le=200)
    """Steps of a training sample; at run time, steps after which the network forgets what it has seen."""
    hidden: int = Field(128, ge=8)
    """Size of the state of an LSTM layer."""
    layers: int = Field(2, ge=1)
    """LSTM layers."""
    modes: int = Field(5, ge=1)
    """Gaussians in the distribution of an action."""
    least_std: float = Field(0.1, gt=0.0)
    """Least standard deviation of a Gaussian, in those of the actions. If it is small, joints that hardly move decide
    which Gaussians are used, and ways that differ in other joints are mixed."""
    pick: Literal["likeliest", "drawn"] = "likeliest"
    """The Gaussian whose mean is the action at run time: the one of greatest weight, or one drawn by weight, always the
    same for a seed and a step."""

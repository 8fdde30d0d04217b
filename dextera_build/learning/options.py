"""Options that all imitation learning rules share."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from dextera_build.policy import contract as contracts
from dextera_build.rule import Fraction, Options


class ImitationOptions(Options):
    """What is learned from, and how the weights are optimised."""

    inputs: tuple[str, ...] = ("joints", "objects", "displacement", "goal")
    """Input channels of the deployable observation; add `rgb` if a film is given, `depth` or `cloud` if it has depth,
    and `world` to tell the policy which kind of world a sample of a mixture is from. Of several cameras, `rgb` are the
    pictures of all, and `rgb/front` those of one."""
    objects: Literal["task", "all"] = "task"
    """Objects with poses and joints in the input: the task's object and those that its goal names (the container that
    it is put into), or all. Irrelevant objects can only mislead a policy trained on a hundred episodes."""
    steps: int = Field(3000, ge=1)
    """Optimiser steps."""
    batch: int = Field(64, ge=1)
    """Samples per step."""
    rate: float = Field(1e-3, gt=0.0)
    """Peak learning rate of AdamW, with cosine decay to 0."""
    warm_up: int = Field(100, ge=1)
    """Steps of linear warm-up of the learning rate."""
    decay: float = Field(1e-4, ge=0.0)
    """Weight decay of AdamW."""
    average: float = Field(0.0, ge=0.0, lt=1.0)
    """Greatest decay of the moving average of the weights, which is what the checkpoint holds (EMA); 0: no average."""
    jitter: float = Field(0.0, ge=0.0)
    """Noise added to inputs in training, in their standard deviations; not to pictures."""
    shift: int = Field(0, ge=0)
    """Maximum random shift of images in training [px]; with a fixed camera, shifts lose position information."""
    crop: float = Field(0.0, ge=0.0, lt=1.0)
    """Maximum fraction of both sides of images that a random crop takes away in training; the rest is enlarged."""
    colour: float = Field(0.0, ge=0.0, lt=1.0)
    """Maximum random change of brightness, contrast, saturation and single colours of images, as a fraction of 1."""
    blur_px: float = Field(0.0, ge=0.0)
    """Maximum standard deviation of a random blur of images [px]."""
    grain: float = Field(0.0, ge=0.0)
    """Standard deviation of noise added to each pixel and colour of images, as a fraction of the range."""
    swap: Fraction = 0.0
    """Fraction of the samples whose background is replaced by a picture of `backdrop`; before all other changes."""
    reach_m: float = Field(3.0, gt=0.0)
    """Distance from the camera above which neither depth nor points are used [m]: walls and the floor behind a table
    would have most of the range of the inputs."""
    holes: Fraction = 0.0
    """Maximum fraction of the pixels of depth, and of the points of a cloud, that are lost in training."""
    bf16: bool = False
    """Whether products in training are of bfloat16, which needs less time and memory on a GPU; weights, their average,
    the optimiser, and the Gaussians of `learn.bc_rnn` stay float32."""
    compiled: bool = False
    """Whether torch compiles the network at the first step, for which the machine needs a C++ compiler; only long
    trainings gain time."""
    snapshot_every: int = Field(0, ge=0)
    """Steps between the snapshots of the weights that the checkpoint holds, for `evaluate.early`; 0: none."""
    held_out: float = Field(0.1, ge=0.0, lt=1.0)
    """Fraction of the episodes held out for validation."""
    seed: int = Field(0, ge=0)
    """Seed of initial weights, order, noise and split."""

    @model_validator(mode="after")
    def _deployable(self) -> ImitationOptions:
        contracts.check_inputs(self.inputs)
        return self

"""learn.openpi: π0.5 and π0 (Black et al. 2025), fine-tuned by openpi's own `train.py`."""

from __future__ import annotations

from typing import Any, Protocol

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.policy.cameras import given
from dextera_build.policy.layout import of_bundle
from dextera_build.rule import Context, rule

from . import exported
from .openpi_options import OpenpiOptions
from .trained import TOLERANCE, Trained, checkpoint

MOST = 32
"""Numbers of an action of π0 and π0.5."""
STATE = "observation.state"


class OpenpiBackend(Protocol):
    """Interface of a backend of learn.openpi."""

    def train(
        self, ctx: Context, data: Folder, camera: str, joints: int, common: OpenpiOptions, options: Any
    ) -> Trained:
        """Train, or resume an interrupted training."""
        ...


@rule(version=1, packages=("numpy", "safetensors"), memory_gb=4.0, tolerance=TOLERANCE)
def openpi(
    ctx: Context[OpenpiBackend], bundle: TaskBundle, data: Folder, view: View, *, options: OpenpiOptions
) -> Checkpoint:
    """Return a π0.5 or π0 that learned from a data set of `demonstrate.lerobot`, v2.1, in openpi's own environment.

    The policy sees the picture of `view`, the joints and the words of the data set. `learn.files` returns its files;
    openpi's server runs them, and `learn.served` asks it.
    """
    version = exported.described(data, "meta/info.json")["codebase_version"]
    if version != "v2.1":
        ctx.fail(f"the data set has version {version}, openpi reads v2.1", hint="data: $lerobot_v21")
    seen = exported.observed(bundle, data, view)
    cameras = [name for name, inputs in seen.features.items() if inputs == ["rgb"]]
    if not cameras:
        ctx.fail("the data set has no pictures", hint="export it with a `film`")
    here = of_bundle(bundle, given(view))
    if len(here.joints) > MOST:
        ctx.fail(f"the robot has {len(here.joints)} joints, {options.model} has {MOST} numbers in an action")
    trained = ctx.backend.train(ctx, data, cameras[0], len(here.joints), options, ctx.backend_options)
    inputs = tuple(channel for channel in seen.channels if channel.name in (*seen.features[STATE], "rgb"))
    settings = {"program": "openpi", "model": options.model, "horizon": options.horizon}
    made = checkpoint(ctx, here, inputs, data, trained, settings)
    ctx.say(f"{options.model} from {trained.facts['base'][:12]}, {options.steps:,} steps, loss {trained.curve[-1]:.4f}")
    return made

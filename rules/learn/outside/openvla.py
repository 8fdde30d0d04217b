"""learn.openvla: adapters for OpenVLA (Kim et al. 2024), trained by OpenVLA's own `finetune.py`."""

from __future__ import annotations

import json
from typing import Any, Protocol

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.policy import contract as contracts
from dextera_build.policy.cameras import given
from dextera_build.policy.layout import of_bundle
from dextera_build.rule import Context, rule

from . import exported
from .openvla_options import OpenvlaOptions
from .trained import TOLERANCE, Trained, checkpoint


class OpenvlaBackend(Protocol):
    """Interface of a backend of learn.openvla."""

    def train(self, ctx: Context, data: Folder, common: OpenvlaOptions, options: Any) -> Trained:
        """Train adapters."""
        ...


@rule(version=1, packages=("numpy", "safetensors"), memory_gb=4.0, tolerance=TOLERANCE)
def openvla(
    ctx: Context[OpenvlaBackend], bundle: TaskBundle, data: Folder, view: View, *, options: OpenvlaOptions
) -> Checkpoint:
    """Return adapters for OpenVLA, trained on a data set of `demonstrate.rlds` in OpenVLA's own environment.

    The policy sees the picture of `view` and the words of the data set, and gives one action. `learn.files` returns the
    adapters with the statistics of the data; OpenVLA's server runs them, and `learn.served` asks it.
    """
    name = _name(ctx, data)
    exported.check(bundle, json.loads(exported.described(data, f"{name}/1.0.0/dataset_info.json")["description"]))
    _check_pictures(ctx, data, name)
    here = of_bundle(bundle, given(view))
    trained = ctx.backend.train(ctx, data, options, ctx.backend_options)
    settings = {"program": "openvla", "unnorm_key": name}
    made = checkpoint(ctx, here, (contracts.channel(here, "rgb"),), data, trained, settings)
    ctx.say(f"adapters of rank {options.rank} for {trained.facts['base'][:12]}, {options.steps:,} steps")
    return made


def _name(ctx: Context[OpenvlaBackend], data: Folder) -> str:
    """Name of the only data set in the folder."""
    names = {path.split("/")[0] for path in data.files if path.endswith("/1.0.0/dataset_info.json")}
    if len(names) != 1:
        ctx.fail("`data` is no data set of demonstrate.rlds", files=len(data.files), hint="data: $rlds")
    return names.pop()


def _check_pictures(ctx: Context[OpenvlaBackend], data: Folder, name: str) -> None:
    if b'"image"' not in data.files[f"{name}/1.0.0/features.json"]:
        ctx.fail("the data set has no pictures, and OpenVLA sees nothing else", hint="export it with a `film`")

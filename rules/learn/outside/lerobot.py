"""learn.lerobot: any policy of LeRobot, trained by LeRobot's own trainer."""

from __future__ import annotations

import json
from typing import Any, Protocol

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.policy.cameras import given
from dextera_build.policy.layout import of_bundle
from dextera_build.rule import Context, rule

from . import exported
from .lerobot_options import LerobotOptions
from .trained import TOLERANCE, Trained, checkpoint


class LerobotBackend(Protocol):
    """Interface of a backend of learn.lerobot."""

    def train(self, ctx: Context, data: Folder, base: Folder | None, common: LerobotOptions, options: Any) -> Trained:
        """Train, or resume an interrupted training."""
        ...


@rule(version=1, packages=("numpy", "safetensors"), memory_gb=4.0, tolerance=TOLERANCE)
def lerobot(
    ctx: Context[LerobotBackend],
    bundle: TaskBundle,
    data: Folder,
    view: View | None = None,
    base: Folder | None = None,
    *,
    options: LerobotOptions,
) -> Checkpoint:
    """Return a policy of LeRobot, trained on a data set of `demonstrate.lerobot` by LeRobot in its own environment.

    The policy learns from all observations of `data`; `view` is the camera of its pictures. With `base`, the files of
    a policy that LeRobot saved, its weights are where the training begins. An interrupted training goes on after its
    last checkpoint.
    """
    seen = exported.observed(bundle, data, view)
    _check_base(ctx, base, options.type)
    trained = ctx.backend.train(ctx, data, base, options, ctx.backend_options)
    settings: dict[str, float | int | str | bool] = {
        "program": "lerobot",
        "type": options.type,
        "features": json.dumps(seen.features),
        "base": exported.digest_of(base) if base is not None else "",
        "seed": options.seed,
    }
    made = checkpoint(ctx, of_bundle(bundle, given(view)), seen.channels, data, trained, settings)
    ctx.say(
        f"{options.type} of LeRobot {trained.facts['version']}: {', '.join(seen.features)}; {options.steps:,} steps, "
        f"loss {trained.curve[-1]:.3f}"
    )
    return made


def _check_base(ctx: Context[LerobotBackend], base: Folder | None, kind: str) -> None:
    if base is None:
        return
    if "config.json" not in base.files or "model.safetensors" not in base.files:
        ctx.fail("`base` has no `config.json` and `model.safetensors`", hint="download a policy of LeRobot into it")
    has = json.loads(base.files["config.json"]).get("type")
    if has != kind:
        ctx.fail(f"`base` is a policy `{has}`, the training is of `{kind}`", hint=f"type: {has}")

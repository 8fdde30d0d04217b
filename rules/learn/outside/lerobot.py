"""learn.lerobot: any policy of LeRobot, trained by LeRobot's own trainer."""

from __future__ import annotations

import json
import math
from typing import Annotated, Any, NamedTuple, Protocol

import numpy as np

from dextera_build.artifacts.base import Array, Folder
from dextera_build.artifacts.tasks.policy import Channel, Checkpoint, PolicyContract
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.learning import curve_picture, packed
from dextera_build.policy.layout import of_bundle
from dextera_build.rule import ROUNDING, Context, Tolerance, rule

from . import exported
from .lerobot_options import LerobotOptions

# Another processor trains other weights of one quality, and a training that went on after a kill has another order.
TOLERANCE = Tolerance({"": ROUNDING, "weights": math.inf, "curve": math.inf}, metrics={"loss": 0.2})


class LerobotTrained(NamedTuple):
    """What LeRobot's trainer leaves."""

    files: Folder
    """`config.json`, `model.safetensors`, and what prepares observations and actions."""
    steps: Annotated[np.ndarray, Array("L", "int64")]
    """Optimiser steps of `curve`."""
    curve: Annotated[np.ndarray, Array("L", "float32")]
    """Training loss."""
    lerobot: str
    """Version of LeRobot."""
    instruction: str
    """The task in words, as the data set has it."""


class LerobotBackend(Protocol):
    """Interface of a backend of learn.lerobot."""

    def train(
        self, ctx: Context, data: Folder, base: Folder | None, common: LerobotOptions, options: Any
    ) -> LerobotTrained:
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
    ctx.check(len(trained.steps) == len(trained.curve) > 0, "the training has no loss curve")
    here = of_bundle(bundle, view)
    ctx.preview(
        curve_picture.draw({"training": (trained.steps, trained.curve)}, f"loss of LeRobot's {options.type}"),
        f"loss over {options.steps:,} steps",
    )
    ctx.metric("loss", float(trained.curve[-1]))
    ctx.say(
        f"{options.type} of LeRobot {trained.lerobot}: {', '.join(seen.features)}; {options.steps:,} steps, "
        f"loss {trained.curve[-1]:.3f}"
    )
    settings = {
        "program": "lerobot",
        "type": options.type,
        "version": trained.lerobot,
        "instruction": trained.instruction,
        "features": json.dumps(seen.features),
        "base": exported.digest_of(base) if base is not None else "",
        "seed": options.seed,
    }
    return Checkpoint(
        weights=packed.to_bytes(trained.files.files),
        contract=PolicyContract(
            algorithm="outside",
            task=here.task,
            embodiment=here.embodiment,
            inputs=seen.channels,
            action=Channel(name="action", shape=(len(here.joints),), names=here.joints),
            rate_hz=here.rate_hz,
            dataset=exported.digest_of(data),
            settings=settings,
        ),
        steps=trained.steps,
        curve=trained.curve,
        curve_name="loss of LeRobot",
    )


def _check_base(ctx: Context[LerobotBackend], base: Folder | None, kind: str) -> None:
    if base is None:
        return
    if "config.json" not in base.files or "model.safetensors" not in base.files:
        ctx.fail("`base` has no `config.json` and `model.safetensors`", hint="download a policy of LeRobot into it")
    has = json.loads(base.files["config.json"]).get("type")
    if has != kind:
        ctx.fail(f"`base` is a policy `{has}`, the training is of `{kind}`", hint=f"type: {has}")

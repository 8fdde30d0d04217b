"""What a trainer of another project leaves, and the checkpoint that is made of it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple

import numpy as np

from dextera_build.artifacts.base import Array, Folder
from dextera_build.artifacts.tasks.policy import Channel, Checkpoint, PolicyContract
from dextera_build.learning import curve_picture, packed
from dextera_build.policy.layout import Layout
from dextera_build.rule import ROUNDING, Context, Tolerance

from . import exported

# Another processor trains other weights of one quality, and a training that went on after a kill has another order.
TOLERANCE = Tolerance({"": ROUNDING, "weights": math.inf, "curve": math.inf}, metrics={"loss": 0.2})


class Trained(NamedTuple):
    """What a trainer leaves."""

    files: Folder
    """The trained policy, or what was trained beside its base; no pickles."""
    steps: Annotated[np.ndarray, Array("L", "int64")]
    """Optimiser steps of `curve`."""
    curve: Annotated[np.ndarray, Array("L", "float32")]
    """Training loss."""
    facts: dict[str, str]
    """What is known of the training: version of the project, instruction, digest of the base, ..."""


def untrained(steps: int, **facts: str) -> Trained:
    """Of the stubs: no weights, and a curve that falls."""
    at = np.array([1, max(2, steps)], np.int64)
    return Trained(Folder(files={"config.json": b"{}"}), at, np.array([1.0, 0.5], np.float32), facts)


def checkpoint(
    ctx: Context[Any],
    here: Layout,
    inputs: tuple[Channel, ...],
    data: Folder,
    trained: Trained,
    settings: Mapping[str, float | int | str | bool],
) -> Checkpoint:
    """The checkpoint of a trainer's files; actions are absolute joint targets [rad].

    Args:
        ctx: The context of the call.
        here: What the task gives to policies.
        inputs: Inputs of the policy, neither encoded nor normalised.
        data: The data set that it learned from.
        trained: What the trainer left.
        settings: What running it needs, in addition to the facts; `program` is the name of the rule.
    """
    name = str(settings["program"])
    ctx.check(len(trained.steps) == len(trained.curve) > 0, "the training has no loss curve")
    ctx.preview(
        curve_picture.draw({"training": (trained.steps, trained.curve)}, f"loss of {name}"),
        f"loss over {trained.steps[-1]:,} steps",
    )
    ctx.metric("loss", float(trained.curve[-1]))
    return Checkpoint(
        weights=packed.to_bytes(trained.files.files),
        contract=PolicyContract(
            algorithm="outside",
            task=here.task,
            embodiment=here.embodiment,
            inputs=inputs,
            action=Channel(name="action", shape=(len(here.joints),), names=here.joints),
            rate_hz=here.rate_hz,
            dataset=exported.digest_of(data),
            settings={**trained.facts, **settings},
        ),
        steps=trained.steps,
        curve=trained.curve,
        curve_name=f"loss of {name}",
    )

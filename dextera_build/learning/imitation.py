"""What all imitation learning rules do: prepare the demonstrations, train, report, and return a checkpoint."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.learning import curve_picture
from dextera_build.learning.demonstrations import Demonstrations, Selection, prepare
from dextera_build.learning.parts import Part
from dextera_build.learning.trained import Trained
from dextera_build.rule import ROUNDING, Context, Options, Tolerance

if TYPE_CHECKING:
    from dextera_build.learning.options import ImitationOptions

# Every step amplifies rounding differences, so weights of two processors are two trainings of one quality.
TOLERANCE = Tolerance({"": ROUNDING, "weights": math.inf, "curve": 0.1}, metrics={"loss": 0.02, "held-out error": 2.0})

NOTHING = (2).to_bytes(8, "little") + b"{}"
"""A safetensors file without tensors."""


class ImitationBackend(Protocol):
    """Interface of a backend of an imitation learning rule."""

    def train(self, ctx: Context, data: Demonstrations, common: Any, options: Any) -> Trained:
        """Train, or resume an interrupted training."""
        ...


def imitated(
    ctx: Context[ImitationBackend],
    bundle: TaskBundle,
    parts: Sequence[Part],
    options: ImitationOptions,
    *,
    algorithm: str,
    settings: Sequence[str],
    loss: str,
) -> Checkpoint:
    """A policy that imitates the episodes, trained by the backend on deployable observations.

    Args:
        ctx: The context of the call.
        bundle: The task.
        parts: Its demonstrations.
        options: Options of the rule.
        algorithm: Name of the folder of the rule.
        settings: Options that define the network and its use at run time; stored in the contract.
        loss: Name of the training loss.
    """
    data = _data(bundle, parts, options, algorithm, {name: getattr(options, name) for name in settings})
    trained = ctx.backend.train(ctx, data, options, ctx.backend_options)
    ctx.check(len(trained.steps) == len(trained.curve) > 0, "the training has no loss curve")
    ctx.preview(
        curve_picture.draw(
            {"training": (trained.steps, trained.curve), "held out": trained.held_out}, f"{loss}, held out: L1 error"
        ),
        f"loss over {options.steps:,} steps, {len(data.train)} episodes",
    )
    _report(ctx, data, trained.error_rad, float(trained.curve[-1]), options.steps)
    return Checkpoint(
        weights=trained.weights,
        contract=data.contract,
        steps=trained.steps,
        curve=trained.curve,
        curve_name=loss,
        snapshots=trained.snapshots,
    )


def untrained(ctx: Context, data: Demonstrations, common: ImitationOptions, options: Options) -> Trained:
    """`train` of the stubs: no weights, and a falling curve."""
    places = np.array([1, max(2, common.steps)], np.int64)
    every = common.snapshot_every
    kept = {str(step): NOTHING for step in range(every, common.steps, every)} if every else {}
    return Trained(NOTHING, places, np.array([1.0, 0.5], np.float32), (places[:0], np.zeros(0, np.float32)), 0.0, kept)


def _data(
    bundle: TaskBundle,
    parts: Sequence[Part],
    options: ImitationOptions,
    algorithm: str,
    settings: Mapping[str, float | int | str | bool],
) -> Demonstrations:
    selection = Selection(options.inputs, options.objects, options.held_out, options.seed, options.reach_m)
    data = prepare(bundle, parts, selection, algorithm=algorithm, settings=settings)
    located = {"located": 0 if data.places is None else data.places.shape[1]}
    return replace(data, contract=data.contract.model_copy(update={"settings": {**settings, **located}}))


def _report(ctx: Context[Any], data: Demonstrations, error_rad: float, loss: float, steps: int) -> None:
    ctx.metric("loss", loss)
    seen = f"{len(data.train)} episodes, {steps:,} steps, loss {loss:.3f}"
    if error_rad:
        ctx.metric("held-out error", error_rad * 1000, "mrad")
        seen += f", held-out error {error_rad * 1000:.1f} mrad"
    ctx.say(seen)

"""learn.act: imitation learning with action chunks (Zhao et al. 2023, arXiv 2304.13705)."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Protocol

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.tasks.episode import Episodes, Film
from dextera_build.artifacts.tasks.mixture import Mixture
from dextera_build.artifacts.tasks.pixels import Pixels
from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.learning import curve_picture
from dextera_build.learning.demonstrations import Demonstrations, Selection, prepare
from dextera_build.learning.parts import Part, parts_of
from dextera_build.rule import ROUNDING, Context, Tolerance, rule

from .act_options import ActOptions
from .trained import Trained

SETTINGS = ("chunk", "width", "heads", "style_layers", "encoder_layers", "decoder_layers", "latent", "every", "forget")
"""Options that define the network and its use at run time; stored in the contract."""


class ActBackend(Protocol):
    """Interface of a backend of learn.act."""

    def train(self, ctx: Context, data: Demonstrations, common: ActOptions, options: Any) -> Trained:
        """Train, or resume an interrupted training."""
        ...


# Every step amplifies rounding differences, so weights of two processors are two trainings of one quality.
@rule(
    version=1,
    packages=("numpy",),
    memory_gb=2.0,
    tolerance=Tolerance(
        {"": ROUNDING, "weights": math.inf, "curve": 0.1}, metrics={"loss": 0.02, "held-out error": 2.0}
    ),
)
def act(
    ctx: Context[ActBackend],
    bundle: TaskBundle,
    episodes: Episodes | Mixture,
    film: Film | Pixels | None = None,
    films: Collection[Film | Pixels] | None = None,
    *,
    options: ActOptions,
) -> Checkpoint:
    """Return a policy that imitates the episodes, trained with ACT on deployable observations.

    Of a mixture, every batch has exactly the numbers of samples that its weights say, and input `world` tells the
    policy which world a sample is from; `films` are its pictures by label. `demonstrate.unpack` decodes films once.
    An interrupted training resumes and ends with the same weights.
    """
    if options.width % options.heads:
        ctx.fail(f"width {options.width} is not a multiple of {options.heads} heads")
    data = _data(bundle, parts_of(episodes, film, films), options)
    trained = ctx.backend.train(ctx, data, options, ctx.backend_options)
    ctx.check(len(trained.steps) == len(trained.curve) > 0, "the training has no loss curve")
    ctx.preview(
        curve_picture.draw({"training": (trained.steps, trained.curve), "held out": trained.held_out}, "L1 loss"),
        f"loss over {options.steps:,} steps, {len(data.train)} episodes",
    )
    _report(ctx, data, trained.error_rad, float(trained.curve[-1]), options.steps)
    return Checkpoint(
        weights=trained.weights,
        contract=data.contract,
        steps=trained.steps,
        curve=trained.curve,
        curve_name="L1 loss",
    )


def _data(bundle: TaskBundle, parts: list[Part], options: ActOptions) -> Demonstrations:
    selection = Selection(options.inputs, options.objects, options.held_out, options.seed)
    settings = {name: getattr(options, name) for name in SETTINGS}
    data = prepare(bundle, parts, selection, algorithm="act", settings=settings)
    located = {"located": 0 if data.places is None else data.places.shape[1]}
    return replace(data, contract=data.contract.model_copy(update={"settings": settings | located}))


def _report(ctx: Context, data: Demonstrations, error_rad: float, loss: float, steps: int) -> None:
    ctx.metric("loss", loss)
    seen = f"{len(data.train)} episodes, {steps:,} steps, loss {loss:.3f}"
    if error_rad:
        ctx.metric("held-out error", error_rad * 1000, "mrad")
        seen += f", held-out error {error_rad * 1000:.1f} mrad"
    ctx.say(seen)

"""learn.diffusion: imitation learning by denoising actions, Diffusion Policy (Chi et al. 2023, arXiv 2303.04137)."""

from __future__ import annotations

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.tasks.backdrop import Backdrop
from dextera_build.artifacts.tasks.episode import Episodes, Film
from dextera_build.artifacts.tasks.mixture import Mixture
from dextera_build.artifacts.tasks.pixels import Pixels
from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.learning.backdrops import behind
from dextera_build.learning.imitation import TOLERANCE, ImitationBackend, imitated
from dextera_build.learning.parts import parts_of
from dextera_build.rule import Context, rule

from .diffusion_options import DiffusionOptions

SETTINGS = (
    *("network", "horizon", "history", "every", "width", "levels", "layers", "heads"),
    *("predicts", "noise_levels", "denoisings", "seed"),
)


@rule(version=3, packages=("numpy",), memory_gb=2.0, tolerance=TOLERANCE, runs={"bundle": "primitive"})
def diffusion(
    ctx: Context[ImitationBackend],
    bundle: TaskBundle,
    episodes: Episodes | Mixture,
    film: Film | Pixels | None = None,
    films: Collection[Film | Pixels] | None = None,
    backdrop: Backdrop | None = None,
    backdrops: Collection[Backdrop] | None = None,
    *,
    options: DiffusionOptions,
) -> Checkpoint:
    """Return a policy that imitates the episodes: a network that turns noise into actions, step by step.

    Where the episodes do one thing in several ways, it does it in one of them, while a policy that predicts one action,
    like that of `learn.act`, may do the average. Mixtures, films and interruptions are as in `learn.act`.
    """
    _check(ctx, options)
    loss = f"error of the {options.predicts}"
    parts = behind(parts_of(episodes, film, films), options.swap, backdrop, backdrops)
    return imitated(ctx, bundle, parts, options, algorithm="diffusion", settings=SETTINGS, loss=loss)


def _check(ctx: Context[ImitationBackend], options: DiffusionOptions) -> None:
    """Refuse sizes that no network has."""
    ahead = options.horizon - options.history + 1
    if options.every > ahead:
        ctx.fail(
            f"every {options.every} is more than the {ahead} predicted steps from the present one",
            horizon=options.horizon,
            history=options.history,
            hint=f"every: {max(1, ahead)}",
        )
    if options.denoisings > options.noise_levels:
        ctx.fail(f"denoisings {options.denoisings} is more than noise_levels {options.noise_levels}")
    halves = 2 ** (options.levels - 1)
    if options.network == "unet" and options.horizon % halves:
        ctx.fail(f"horizon {options.horizon} is not a multiple of {halves}, the shortening by {options.levels} levels")
    if options.network == "transformer" and options.width % options.heads:
        ctx.fail(f"width {options.width} is not a multiple of {options.heads} heads")

"""learn.act: imitation learning with action chunks (Zhao et al. 2023, arXiv 2304.13705)."""

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

from .act_options import ActOptions

SIZES = ("chunk", "width", "heads", "style_layers", "encoder_layers", "decoder_layers", "latent", "feed_forward")
SETTINGS = (*SIZES, "every", "forget")


@rule(version=2, packages=("numpy",), memory_gb=2.0, tolerance=TOLERANCE, runs={"bundle": "primitive"})
def act(
    ctx: Context[ImitationBackend],
    bundle: TaskBundle,
    episodes: Episodes | Mixture,
    film: Film | Pixels | None = None,
    films: Collection[Film | Pixels] | None = None,
    backdrop: Backdrop | None = None,
    backdrops: Collection[Backdrop] | None = None,
    *,
    options: ActOptions,
) -> Checkpoint:
    """Return a policy that imitates the episodes, trained with ACT on deployable observations.

    Of a mixture, every batch has exactly the numbers of samples that its weights say, and input `world` tells the
    policy which world a sample is from. `film` is what the only camera saw, `films` what several saw, by camera; of a
    mixture they are by label, or by `LABEL.CAMERA`. `demonstrate.unpack` decodes films once.
    An interrupted training resumes and ends with the same weights.
    """
    if options.width % options.heads:
        ctx.fail(f"width {options.width} is not a multiple of {options.heads} heads")
    if options.every > options.chunk:
        ctx.fail(
            f"every {options.every} is more than the {options.chunk} steps of a chunk", hint=f"every: {options.chunk}"
        )
    parts = behind(parts_of(episodes, film, films), options.swap, backdrop, backdrops)
    return imitated(ctx, bundle, parts, options, algorithm="act", settings=SETTINGS, loss="L1 loss")

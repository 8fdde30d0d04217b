"""learn.bc_rnn: behaviour cloning with a recurrent network and Gaussian mixtures (Mandlekar et al. 2021)."""

from __future__ import annotations

from dataclasses import replace

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

from .bc_rnn_options import BcRnnOptions

SETTINGS = ("horizon", "hidden", "layers", "modes", "least_std", "pick", "seed")
# Densities of narrow Gaussians amplify rounding; in the middle of a training, curves of two processors differ by 0.09.
WIDER = replace(TOLERANCE, fields={**TOLERANCE.fields, "curve": 1.0}, metrics={**TOLERANCE.metrics, "loss": 0.1})


@rule(version=2, packages=("numpy",), memory_gb=2.0, tolerance=WIDER, runs={"bundle": "primitive"})
def bc_rnn(
    ctx: Context[ImitationBackend],
    bundle: TaskBundle,
    episodes: Episodes | Mixture,
    film: Film | Pixels | None = None,
    films: Collection[Film | Pixels] | None = None,
    backdrop: Backdrop | None = None,
    backdrops: Collection[Backdrop] | None = None,
    *,
    options: BcRnnOptions,
) -> Checkpoint:
    """Return a policy that imitates the episodes, trained with BC-RNN-GMM on deployable observations.

    An LSTM reads windows of `horizon` steps and gives a mixture of Gaussians over the joint targets of each, so that
    the policy remembers what it saw, and keeps apart the ways in which a task was shown. The loss is the negative
    logarithm of the likelihood of the demonstrated action, divided by the number of joints. Data are as in `learn.act`.
    An interrupted training resumes and ends with the same weights.
    """
    parts = behind(parts_of(episodes, film, films), options.swap, backdrop, backdrops)
    return imitated(ctx, bundle, parts, options, algorithm="bc_rnn", settings=SETTINGS, loss="negative log-likelihood")

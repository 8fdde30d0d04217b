"""learn.ppo with an own PPO in worlds of MuJoCo Warp, on one device."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING

import torch
from pydantic import Field

from dextera_build.artifacts.tasks.policy import PolicyContract
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.learning import reproducible
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.training.tensors.worlds import TensorWorlds

from .own_ppo import Learner, Settings, TwoSighted
from .own_training import Training
from .ppo_sb3 import heading, nearest
from .practised import Practised

if TYPE_CHECKING:
    from .ppo_options import PpoOptions

__all__ = ["BACKEND", "WarpOptions", "heading", "nearest", "practise"]

BACKEND = Backend(
    summary="thousands of worlds in MuJoCo Warp and PPO on tensors, on a GPU; a few on a CPU; resumes",
    packages=(
        "mujoco-warp",
        "warp-lang",
        "torch",
        "mujoco",
        "stable-baselines3",
        "gymnasium",
        "mink",
        "daqp",
        "safetensors",
    ),
    extra="batch",
    gpu_gb=8.0,
    cpu=True,
)


class WarpOptions(Options):
    """Options of backend `warp`; in a recipe `warp: {pool: 1024}`."""

    pool: int = Field(256, ge=1)
    """Number of starts, drawn before the training, from which episodes begin."""
    clip: float = Field(0.2, gt=0.0)
    """Most change of the ratio of probabilities that is rewarded."""
    value_clip: float = Field(0.0, ge=0.0)
    """Most change of a value per update; 0: any."""
    kl: float = Field(0.0, ge=0.0)
    """Divergence per update that the learning rate follows, such as 0.01; 0: the rate decays to a tenth."""


def practise(
    ctx: Context,
    bundle: TaskBundle,
    contract: PolicyContract,
    terms: tuple[TermSpec, ...],
    common: PpoOptions,
    options: WarpOptions,
) -> Practised:
    """Train, or resume an interrupted training."""
    settings = Settings(
        rollout=common.rollout,
        batch=common.batch,
        epochs=common.epochs,
        discount=common.discount,
        entropy=common.entropy,
        clip=options.clip,
        value_clip=options.value_clip,
        kl=options.kl,
    )
    with ExitStack() as stack:
        stack.enter_context(reproducible.one_thread())
        worlds = TensorWorlds(bundle, contract, common.worlds, common.seed, pool=options.pool, device=ctx.device)
        stack.enter_context(worlds.here())
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(common.seed)
            policy = TwoSighted(worlds, common.width, common.layers, common.spread).to(worlds.device)
        learner = Learner(worlds, policy, settings, common.rate)
        return Training(ctx, learner, worlds, contract, common, options).run()

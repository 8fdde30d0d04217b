"""learn.ppo with stable-baselines3 on MuJoCo."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.policies import ActorCriticPolicy
from torch import Tensor, nn

from dextera_build.artifacts.tasks.policy import PolicyContract
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.errors import RuleError
from dextera_build.learning import reproducible
from dextera_build.policy.added import of_specs
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.control.mechanism import Mechanism
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.training.practice import Practices

from .network import Actor
from .ppo_state import Watch, own_generators
from .ppo_worlds import Worlds
from .practised import Practised

if TYPE_CHECKING:
    from .ppo_options import PpoOptions

BACKEND = Backend(
    summary="stable-baselines3 on MuJoCo, deterministic; resumes after an interruption",
    profiles=("cpu",),
    packages=("stable-baselines3", "gymnasium", "torch", "mujoco", "mink", "daqp", "safetensors"),
    extra="learn",
)


def nearest(ctx: Context, bundle: TaskBundle, options: Options) -> str:
    """The limb whose palm is nearest to the task's object in the photographed configuration."""
    environment, robot = Environment(bundle), bundle.robot
    thing = environment.object_poses()[list(bundle.objects).index(bundle.task.object), :3]
    away = np.linalg.norm(environment.palm_poses()[:, :3] - thing, axis=1)
    found = {name: float(far) for name, far in zip(robot.limb_names, away, strict=True) if robot.limbs[name].palm}
    return min(found, key=lambda name: found[name], default=robot.limb_names[0])


def heading(ctx: Context, bundle: TaskBundle, options: Options) -> float | None:
    """Initial push direction of the task's link about the vertical in the base [rad]; None if it has none."""
    environment = Environment(bundle)
    pushed = environment.primitive.pushed(environment.now, environment.now)
    if pushed is None:
        return None
    (name,), (way,) = (each.tolist() for each in pushed)
    mechanism = Mechanism(environment.model, name)
    _, along = mechanism.pushed_at(way, 1.0)
    link = int(environment.model.jnt_bodyid[environment.data.joint(name).id])
    ahead = bundle.base_pose.matrix[:3, :3].T @ environment.data.xmat[link].reshape(3, 3) @ along
    return float(np.arctan2(ahead[1], ahead[0]))


def practise(
    ctx: Context,
    bundle: TaskBundle,
    contract: PolicyContract,
    terms: tuple[TermSpec, ...],
    common: PpoOptions,
    options: Options,
) -> Practised:
    """Train, or resume an interrupted training."""
    added = of_specs(terms, ctx.companion)
    worlds = Worlds(Practices(bundle, contract, common.worlds, common.seed, threads=common.threads, terms=added))
    try:
        with reproducible.one_thread(), own_generators(common.seed):
            model = _model(worlds, common)
            watch = Watch(ctx, worlds, contract, common)
            watch.restore(model)
            _learn(model, watch, common)
        return watch.practised()
    finally:
        worlds.close()


def _learn(model: PPO, watch: Watch, options: PpoOptions) -> None:
    left = max(0, options.steps - model.num_timesteps)
    model.set_logger(Logger(None, []))  # the default one writes to a new temporary folder
    try:
        model.learn(left, callback=watch, reset_num_timesteps=False)
    except ValueError as error:
        # Torch's distributions reject non-finite parameters and a spread of 0.
        if "distribution" not in str(error):
            raise
        raise RuleError(
            f"the training diverged before decision {model.num_timesteps:,}",
            code="DXB-B513",
            hint=f"rate: {options.rate * 0.3:g}",
        ) from None


def _model(worlds: Worlds, options: PpoOptions) -> PPO:
    return PPO(
        TwoSighted,
        worlds,
        learning_rate=lambda left: options.rate * (0.1 + 0.9 * left),
        n_steps=options.rollout,
        batch_size=options.batch,
        n_epochs=options.epochs,
        gamma=options.discount,
        gae_lambda=0.95,
        clip_range=0.2,
        ent_coef=options.entropy,
        max_grad_norm=0.5,
        target_kl=0.05,
        policy_kwargs={
            "public": worlds.public,
            "width": options.width,
            "layers": options.layers,
            "log_std_init": float(np.log(options.spread)),
        },
        seed=None,
        device="cpu",
    )


class TwoSighted(ActorCriticPolicy):
    """An actor that sees the first `public` numbers of an observation, and a critic that sees all."""

    def __init__(self, *args: Any, public: int, width: int, layers: int, **kwargs: Any) -> None:
        self._public, self._width, self._layers = public, width, layers
        super().__init__(*args, **kwargs)

    def _build_mlp_extractor(self) -> None:
        self.mlp_extractor = Extractor(  # type: ignore[assignment]
            self._public, self.features_dim, self._width, self._layers
        )


class Extractor(nn.Module):
    """Features for actor and critic, with the interface of stable-baselines3."""

    def __init__(self, public: int, seen: int, width: int, layers: int) -> None:
        super().__init__()
        self._public = public
        self.latent_dim_pi = self.latent_dim_vf = width
        self.actor = Actor(public, width, layers, 1).body
        self.critic = Actor(seen, width, layers, 1).body

    def forward(self, numbers: Tensor) -> tuple[Tensor, Tensor]:
        """Features of both."""
        return self.forward_actor(numbers), self.forward_critic(numbers)

    def forward_actor(self, numbers: Tensor) -> Tensor:
        """Features (B, width) of the deployable numbers."""
        found: Tensor = self.actor(numbers[:, : self._public])
        return found

    def forward_critic(self, numbers: Tensor) -> Tensor:
        """Features (B, width) of all numbers."""
        found: Tensor = self.critic(numbers)
        return found

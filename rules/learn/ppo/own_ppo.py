"""PPO on tensors (Schulman et al. 2017, arXiv 1707.06347): rollouts, advantages and updates on one device.

Differences from the first paper are those of Andrychowicz et al. 2021 (arXiv 2006.05990): running statistics
normalise observations, values are clipped as ratios are, and the learning rate may follow the divergence of an update
(Schulman's adaptive penalty, as in rsl_rl).
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, Protocol

import torch
from torch import Tensor, nn

from .network import Actor

LAMBDA = 0.95
"""Decay of later errors of the critic in advantages (Schulman et al. 2016)."""
MOST_KL = 0.05
"""Divergence at which the epochs of an update end, if the rate does not follow it."""
RATES = (1e-5, 1e-2)
"""Range of a learning rate that follows the divergence."""


class Step(Protocol):
    """One decision in every world, see `sim.training.tensors.worlds.Step`."""

    seen: Tensor
    last: Tensor
    rewards: Tensor
    ended: Tensor
    late: Tensor
    success: Tensor


class Worlds(Protocol):
    """N worlds on a device, see `sim.training.tensors.worlds.TensorWorlds`."""

    count: int
    size: int
    public: int
    decisions: int
    device: torch.device

    def here(self) -> AbstractContextManager[None]:
        """A context in which torch works in the stream of the simulator."""
        ...

    def reset(self) -> Tensor:
        """Begin an episode in every world; the observations (N, K + P)."""
        ...

    def step(self, decisions: Tensor) -> Any:
        """Execute one decision (N, M) in every world; a `Step`."""
        ...


@dataclass(frozen=True)
class Settings:
    """Numbers of the algorithm."""

    rollout: int
    """T, decisions per world between two updates."""
    batch: int
    """Decisions per gradient step."""
    epochs: int
    """Passes over a rollout."""
    discount: float
    """Discount factor per decision."""
    entropy: float = 0.0
    """Weight of the policy's entropy."""
    clip: float = 0.2
    """Most change of the ratio of probabilities that is rewarded."""
    value_clip: float = 0.0
    """Most change of a value per update, in units of the value; 0: any."""
    kl: float = 0.0
    """Divergence that the learning rate follows; 0: the rate is given."""


class Running(nn.Module):
    """Mean and variance of everything seen so far (Chan et al. 1979), and the normalisation by them.

    Args:
        size: Numbers of an observation.
    """

    def __init__(self, size: int) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(size))
        self.register_buffer("variance", torch.ones(size))
        self.register_buffer("count", torch.zeros(()))

    mean: Tensor
    variance: Tensor
    count: Tensor

    def see(self, numbers: Tensor) -> None:
        """Take observations (..., size) into account."""
        flat = numbers.reshape(-1, numbers.shape[-1])
        total = self.count + len(flat)
        apart = flat.mean(0) - self.mean
        spread = self.variance * self.count + flat.var(0, unbiased=False) * len(flat)
        self.variance.copy_((spread + apart.square() * self.count * len(flat) / total) / total)
        self.mean.add_(apart * len(flat) / total)
        self.count.copy_(total)

    @property
    def scale(self) -> Tensor:
        """Standard deviations; 1 for what never changed."""
        return torch.where(self.variance > 1e-8, self.variance.clamp(min=1e-8).sqrt(), 1.0)

    def forward(self, numbers: Tensor) -> Tensor:
        """Normalised observations."""
        return (numbers - self.mean) / self.scale


class TwoSighted(nn.Module):
    """An actor that sees the first `public` numbers of an observation, and a critic that sees all of them."""

    def __init__(self, worlds: Worlds, width: int, layers: int, spread: float) -> None:
        super().__init__()
        self.public = worlds.public
        self.actor = Actor(worlds.public, width, layers, worlds.decisions)
        self.critic = Actor(worlds.size, width, layers, 1)
        self.running = Running(worlds.size)
        self.log_spread = nn.Parameter(torch.full((worlds.decisions,), spread).log())
        for part in (self.actor, self.critic):
            for layer in part.modules():
                if isinstance(layer, nn.Linear):
                    nn.init.orthogonal_(layer.weight, 2**0.5)
                    nn.init.zeros_(layer.bias)
        nn.init.orthogonal_(self.actor.head.weight, 0.01)
        nn.init.orthogonal_(self.critic.head.weight, 1.0)

    def decided(self, numbers: Tensor) -> Tensor:
        """Means of the decisions (B, M) for normalised observations."""
        found: Tensor = self.actor(numbers[:, : self.public])
        return found

    def valued(self, numbers: Tensor) -> Tensor:
        """Values (B,) for normalised observations."""
        found: Tensor = self.critic(numbers)
        return found[:, 0]

    def likelihood(self, means: Tensor, decisions: Tensor) -> Tensor:
        """Log probabilities (B,) of decisions (B, M)."""
        apart = (decisions - means) / self.log_spread.exp()
        return -(0.5 * apart.square() + self.log_spread + 0.5 * torch.log(torch.tensor(2 * torch.pi))).sum(-1)

    def plain(self) -> dict[str, Tensor]:
        """The actor on observations that are not normalised: the statistics become part of its first layer."""
        tensors = {name: tensor.detach().clone() for name, tensor in self.actor.state_dict().items()}
        first = next(name for name in tensors if name.endswith("weight")).removesuffix("weight")
        mean, scale = self.running.mean[: self.public], self.running.scale[: self.public]
        tensors[f"{first}weight"] = weight = tensors[f"{first}weight"] / scale
        tensors[f"{first}bias"] = tensors[f"{first}bias"] - weight @ mean
        return tensors


@dataclass(frozen=True)
class Rollout:
    """T decisions in N worlds."""

    seen: Tensor
    """Normalised observations (T, N, K + P)."""
    decisions: Tensor
    """(T, N, M)."""
    likelihood: Tensor
    """Log probabilities of the decisions (T, N)."""
    values: Tensor
    """Of the observations (T, N)."""
    advantages: Tensor
    """(T, N)."""
    earned: Tensor
    """Rewards of the episodes that ended (T, N), NaN elsewhere."""
    success: Tensor
    """Whether they succeeded (T, N) bool."""


def advantages(
    rewards: Tensor, values: Tensor, over: Tensor, following: Tensor, discount: float, decay: float = LAMBDA
) -> Tensor:
    """Generalised advantage estimates (T, N) (Schulman et al. 2016, arXiv 1506.02438, equation 16).

    Args:
        rewards: (T, N); the last one of an episode that the time limit ended includes the value of its last state.
        values: Of the states in which the decisions were made (T, N).
        over: Whether an episode ended with a decision (T, N) bool.
        following: Values of the states after the last decision (N,).
        discount: Per decision.
        decay: Lambda.
    """
    found, later = torch.zeros_like(rewards), torch.zeros_like(following)
    for step in range(len(rewards) - 1, -1, -1):
        goes_on = (~over[step]).to(rewards.dtype)
        error = rewards[step] + discount * following * goes_on - values[step]
        later = error + discount * decay * goes_on * later
        found[step], following = later, values[step]
    return found


class Learner:
    """A policy that practises in worlds.

    Args:
        worlds: Where.
        policy: What learns, on the same device.
        settings: How.
        rate: Initial learning rate of Adam.
    """

    def __init__(self, worlds: Worlds, policy: TwoSighted, settings: Settings, rate: float) -> None:
        self.worlds, self.policy, self.settings = worlds, policy, settings
        self.optimiser = torch.optim.Adam(policy.parameters(), lr=rate, eps=1e-5)
        self.seen = torch.zeros(0)
        """Observations of the worlds as they are, not normalised (N, K + P)."""
        self.earned = torch.zeros(worlds.count, device=worlds.device)
        """Rewards of the running episodes (N,)."""

    @property
    def rate(self) -> float:
        """The learning rate."""
        return float(self.optimiser.param_groups[0]["lr"])

    @rate.setter
    def rate(self, rate: float) -> None:
        self.optimiser.param_groups[0]["lr"] = rate

    @torch.no_grad()
    def collect(self, random: torch.Generator) -> Rollout:
        """Practise for a rollout."""
        policy, settings, worlds = self.policy, self.settings, self.worlds
        spread = policy.log_spread.exp()
        parts: dict[str, list[Tensor]] = {}
        raw = []
        for _ in range(settings.rollout):
            raw.append(self.seen)
            seen = policy.running(self.seen)
            means = policy.decided(seen)
            noise = torch.randn(means.shape, generator=random, device=worlds.device)
            decisions = means + spread * noise
            step = worlds.step(decisions)
            over = step.ended | step.late
            self.earned = self.earned + step.rewards
            # An episode that time ended would have gone on: its last state is worth what the critic says.
            beyond = torch.where(step.late & ~step.ended, policy.valued(policy.running(step.last)), 0.0)
            for name, tensor in {
                "seen": seen,
                "decisions": decisions,
                "likelihood": policy.likelihood(means, decisions),
                "values": policy.valued(seen),
                "rewards": step.rewards + settings.discount * beyond,
                "over": over,
                "earned": torch.where(over, self.earned, torch.nan),
                "success": step.success,
            }.items():
                parts.setdefault(name, []).append(tensor)
            self.earned = torch.where(over, torch.zeros_like(self.earned), self.earned)
            self.seen = step.seen
        made = {name: torch.stack(tensors) for name, tensors in parts.items()}
        following = policy.valued(policy.running(self.seen))
        rewards, over = made.pop("rewards"), made.pop("over")
        found = advantages(rewards, made["values"], over, following, settings.discount)
        policy.running.see(torch.stack(raw))
        return Rollout(**made, advantages=found)

    def update(self, rollout: Rollout, random: torch.Generator) -> float:
        """Improve the policy on a rollout; the mean loss of the gradient steps, NaN as soon as one is not finite."""
        flat = {name: tensor.flatten(0, 1) for name, tensor in vars(rollout).items()}
        count, losses = len(flat["values"]), list[float]()
        for _ in range(self.settings.epochs):
            order = torch.randperm(count, generator=random, device=flat["values"].device)
            for rows in torch.split(order, self.settings.batch):
                if len(rows) < 2:  # advantages of one decision have no spread
                    continue
                loss, divergence = self._step({name: tensor[rows] for name, tensor in flat.items()})
                losses.append(loss)
                if loss != loss:
                    return loss
                if not self.settings.kl and divergence > 1.5 * MOST_KL:
                    return sum(losses) / len(losses)
        return sum(losses) / len(losses)

    def _step(self, batch: Mapping[str, Tensor]) -> tuple[float, float]:
        """One gradient step; loss and divergence. Without a step, NaN or a divergence that is too large."""
        policy, settings = self.policy, self.settings
        means, values = policy.decided(batch["seen"]), policy.valued(batch["seen"])
        change = policy.likelihood(means, batch["decisions"]) - batch["likelihood"]
        ratio = change.exp()
        divergence = float((ratio - 1.0 - change).detach().mean())
        if settings.kl:
            self._follow(divergence)
        elif divergence > 1.5 * MOST_KL:
            return 0.0, divergence
        gain = batch["advantages"]
        gain = (gain - gain.mean()) / (gain.std() + 1e-8)
        clipped = ratio.clamp(1.0 - settings.clip, 1.0 + settings.clip)
        surrogate = -torch.minimum(ratio * gain, clipped * gain).mean()
        wanted = batch["advantages"] + batch["values"]
        missed = (values - wanted).square()
        if settings.value_clip:
            near = batch["values"] + (values - batch["values"]).clamp(-settings.value_clip, settings.value_clip)
            missed = torch.maximum(missed, (near - wanted).square())
        entropy = policy.log_spread.sum()  # up to a constant
        loss = surrogate + 0.5 * missed.mean() - settings.entropy * entropy
        if not bool(torch.isfinite(loss)):
            return float("nan"), divergence
        self.optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        nn.utils.clip_grad_norm_(policy.parameters(), 0.5)
        self.optimiser.step()
        return float(loss.detach()), divergence

    def _follow(self, divergence: float) -> None:
        """Let the learning rate follow the divergence."""
        if divergence > 2.0 * self.settings.kl:
            self.rate = max(RATES[0], self.rate / 1.5)
        elif 0.0 < divergence < 0.5 * self.settings.kl:
            self.rate = min(RATES[1], self.rate * 1.5)

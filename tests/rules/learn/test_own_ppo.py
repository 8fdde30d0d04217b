"""PPO on tensors: that it learns what is known, what its advantages are, and what the end of an episode is worth."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from dextera_build.learning import reproducible
from rules.learn.ppo.own_ppo import Learner, Running, Settings, TwoSighted, advantages

SETTINGS = Settings(rollout=16, batch=128, epochs=4, discount=0.9)
FAR = 40.0
"""Where the line is seen from: far beyond the scale of a network's input."""


class Line:
    """Points on a line, which a decision moves by up to 0.2; the reward is how much nearer they come to 0.

    Args:
        late: Decisions after which the time limit ends an episode.
        bad: Whether rewards are no numbers.
        ends: Whether that is an end instead, after which nothing is worth anything.
    """

    count, size, public, decisions = 16, 2, 1, 1
    device = torch.device("cpu")

    def __init__(self, late: int = 8, bad: bool = False, ends: bool = False) -> None:
        self._late, self._bad, self._ends, self._random = late, bad, ends, torch.Generator()
        self._random.manual_seed(0)

    def here(self) -> AbstractContextManager[None]:
        return nullcontext()

    def reset(self) -> Tensor:
        self._steps, self._place = torch.zeros(self.count), self._drawn()
        return self._seen()

    def step(self, decisions: Tensor) -> Any:
        before = self._place.abs()
        self._place = self._place + 0.2 * decisions[:, 0].clamp(-1.0, 1.0)
        self._steps = self._steps + 1
        rewards, over, last = before - self._place.abs(), self._steps >= self._late, self._seen()
        self._place = torch.where(over, self._drawn(), self._place)
        self._steps = torch.where(over, 0.0, self._steps)
        none = torch.zeros_like(over)
        ended, late = (over, none) if self._ends else (none, over)
        rewards = rewards * torch.nan if self._bad else rewards
        success = over & (last[:, 0] - FAR).abs().lt(0.1)
        return SimpleNamespace(seen=self._seen(), last=last, rewards=rewards, ended=ended, late=late, success=success)

    def _drawn(self) -> Tensor:
        return torch.rand(self.count, generator=self._random) * 2.0 - 1.0

    def _seen(self) -> Tensor:
        return torch.stack([self._place + FAR, self._steps], dim=1)


def learner(worlds: Line, settings: Settings = SETTINGS, rate: float = 3e-3) -> Learner:
    torch.manual_seed(0)
    made = Learner(worlds, TwoSighted(worlds, 16, 2, 0.5), settings, rate)
    made.seen = worlds.reset()
    return made


def practised(made: Learner, rollouts: int) -> list[float]:
    """Mean rewards of the episodes of each rollout."""
    random, earned = torch.Generator(), []
    with reproducible.one_thread():
        for number in range(rollouts):
            random.manual_seed(number)
            rollout = made.collect(random)
            made.update(rollout, random)
            earned.append(float(rollout.earned.nanmean()))
    return earned


@pytest.mark.medium
@pytest.mark.parametrize("kl", [0.0, 0.01], ids=["rate given", "rate follows"])
def test_it_learns_what_chance_does_not_reach(kl: float) -> None:
    """The best policy earns 0.5 in the mean, the distance of the starts; chance earns less than nothing."""
    made = learner(Line(), Settings(**{**vars(SETTINGS), "kl": kl, "value_clip": 0.2}))
    earned = practised(made, 24)
    assert np.mean(earned[:3]) < 0.1
    assert np.mean(earned[-3:]) > 0.4


def test_the_same_seed_gives_the_same_weights() -> None:
    one, other = (learner(Line()) for _ in range(2))
    assert practised(one, 3) == practised(other, 3)
    pairs = zip(one.policy.plain().items(), other.policy.plain().items(), strict=True)
    assert all(a == b and x.equal(y) for (a, x), (b, y) in pairs)


def test_advantages_are_those_of_the_formula() -> None:
    """Of each episode alone: the sum of later errors of the critic, each discounted by 0.9 times 0.8."""
    random = np.random.default_rng(0)
    rewards, values = random.normal(size=(2, 12, 3))
    over, following = random.uniform(size=(12, 3)) < 0.3, random.normal(size=3)
    parts = [torch.tensor(each) for each in (rewards, values, over, following)]
    found = advantages(*parts, discount=0.9, decay=0.8)
    for world in range(3):
        for step in range(12):
            wanted = 0.0
            for later in range(step, 12):
                beyond = values[later + 1, world] if later < 11 else following[world]
                error = rewards[later, world] + 0.9 * beyond * (not over[later, world]) - values[later, world]
                wanted += (0.9 * 0.8) ** (later - step) * error
                if over[later, world]:
                    break
            assert found[step, world] == pytest.approx(wanted)


@pytest.mark.parametrize("ends", [False, True], ids=["the time limit", "an end"])
def test_only_after_the_time_limit_a_last_state_has_a_value(ends: bool) -> None:
    """With a critic that says 2 everywhere, and episodes of a single decision."""
    made = learner(Line(late=1, ends=ends))
    with torch.no_grad():
        made.policy.critic.head.weight.zero_()
        made.policy.critic.head.bias.fill_(2.0)
    rollout = made.collect(torch.Generator())
    worth = 0.0 if ends else 0.9 * 2.0
    torch.testing.assert_close(rollout.advantages, rollout.earned + worth - 2.0)


def test_running_statistics_are_those_of_all_that_was_seen() -> None:
    parts = [3.0 + torch.randn(7, 5, 2, generator=torch.Generator().manual_seed(n)) for n in range(3)]
    running, flat = Running(2), torch.cat(parts).reshape(-1, 2)
    for part in parts:
        running.see(part)
    torch.testing.assert_close(running.mean, flat.mean(0))
    torch.testing.assert_close(running.scale, flat.std(0, unbiased=False))


def test_the_weights_of_a_policy_take_what_is_not_normalised() -> None:
    made = learner(Line())
    practised(made, 2)
    seen = made.seen[:, :1]
    wanted = made.policy.actor((seen - made.policy.running.mean[:1]) / made.policy.running.scale[:1])
    made.policy.actor.load_state_dict(made.policy.plain())
    torch.testing.assert_close(made.policy.actor(seen), wanted, atol=1e-4, rtol=0.0)


def test_a_loss_that_is_no_number_changes_no_weights() -> None:
    made = learner(Line(bad=True))
    before = {name: tensor.clone() for name, tensor in made.policy.actor.state_dict().items()}
    random = torch.Generator()
    assert np.isnan(made.update(made.collect(random), random))
    assert all(tensor.equal(before[name]) for name, tensor in made.policy.actor.state_dict().items())

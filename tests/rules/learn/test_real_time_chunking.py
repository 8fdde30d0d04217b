"""Real-time chunking of learn.diffusion: answers continue what a robot carries out until they arrive."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="needs rosbags (extra `ros`)")

from dextera_build.artifacts.tasks.episode import Episode, Episodes
from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.deploying.ahead import Ahead, Chunked
from dextera_build.deploying.continuing import Continuing
from dextera_build.errors import RuleError
from dextera_build.policy.continuing import Plan
from dextera_build.sim.runtime import policies
from tests import episodes
from tests.policy.policies import checkpoint, contract, observation, runner
from tests.rules.learn.test_diffusion import learn
from tests.rules.learn.trainings import BUNDLE

HOME = np.array(episodes.HOME)
SIDE_RAD = 0.5
"""How far the first joint goes to either side, and back."""
LENGTH = 24
"""Steps of an episode."""
RATE_HZ = 20.0
TRAINING: dict[str, Any] = {
    "inputs": ("joints",),
    "width": 32,
    "levels": 2,
    "horizon": 16,
    "every": 8,
    "denoisings": 10,
    "steps": 800,
    "batch": 32,
    "rate": 2e-3,
    "warm_up": 50,
    "held_out": 0.0,
}
"""Options of a policy that learns `sides` in half a minute."""


def sides(count: int) -> Episodes:
    """Episodes that go round an obstacle on either side; no observation tells on which, only how far they are."""

    def way(side: float) -> np.ndarray:
        phase = (np.arange(LENGTH) + 1)[:, None] / LENGTH
        return np.asarray(HOME + np.sin(np.pi * phase) * [side * SIDE_RAD, 0, 0] + phase * [0, 0.3, 0], np.float32)

    def gone(one: Episode, side: float) -> Episode:
        path = way(side)
        joints = np.concatenate([HOME[None], path[:-1]]).astype(np.float32)
        joints[:, 0] = HOME[0]
        return episodes.observed(one, joints=joints).model_copy(update={"action": path, "executed": path})

    made = episodes.small(count, LENGTH)
    pairs = zip(made.items.items(), np.tile([-1.0, 1.0], count // 2), strict=True)
    return made.model_copy(update={"items": {name: gone(one, side) for (name, one), side in pairs}})


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Checkpoint:
    return learn(tmp_path_factory.mktemp("trained"), sides(32), **TRAINING)


class Replaced(Continuing):
    """Its answers continue nothing: each replaces the one before."""

    plan = property(lambda self: None, lambda self, plan: None)  # type: ignore[assignment]


class Ran:
    """An episode in virtual time, in which an answer takes `delay` control periods.

    The robot is where it was told to be one period before.
    """

    def __init__(self, made: Checkpoint, continuing: Continuing, delay: int, number: int) -> None:
        self._time, self._delay = 0, round((delay - 0.5) / RATE_HZ * 1e9)
        self.plans: list[tuple[Plan | None, np.ndarray]] = []
        """What each answer had to continue, and the answer."""
        self.sent = [HOME]
        policy = policies.load(continuing, made, BUNDLE)
        self._continuing, self._chunk = continuing, policy.chunk
        policy.chunk = self._noted  # type: ignore[method-assign]
        ahead = Ahead(
            policy,
            lambda: self.sent[-1],
            rate_hz=RATE_HZ,
            chunked=Chunked(8),
            answer_s=1.0,
            now=lambda: self._time,
            worker=self,
            continuing=continuing,
        )
        for step in range(LENGTH):
            self._time = max(self._time, round(step / RATE_HZ * 1e9))
            # What differs between episodes decides the noise, and nothing else.
            seen = np.array([HOME[0], *self.sent[-1][1:]]) + (2e-4 * number if step == 0 else 0.0)
            self.sent.append(ahead.act(observation(joints=seen)))
        self.waited = ahead.waited

    def _noted(self, *args: Any, **more: Any) -> np.ndarray:
        self.plans.append((self._continuing.plan, self._chunk(*args, **more)))
        return self.plans[-1][1]

    def submit(self, function: Callable[..., np.ndarray], /, *args: Any) -> Future[np.ndarray]:
        run, made, ready = self, function(*args), self._time + self._delay

        class Late(Future[np.ndarray]):
            def done(self) -> bool:
                return run._time >= ready

            def result(self, timeout: float | None = None) -> np.ndarray:
                run._time = max(run._time, ready)
                return made

        return Late()

    def changes(self) -> bool:
        """Whether it was on both sides."""
        found = np.array(self.sent[1:])[:, 0] - HOME[0]
        return bool(found.min() < -SIDE_RAD / 4 and found.max() > SIDE_RAD / 4)

    def jump(self) -> float:
        """Largest step of the first joint after the first command [rad]."""
        return float(np.abs(np.diff(np.array(self.sent[1:])[:, 0])).max())


@pytest.mark.slow
@pytest.mark.parametrize("delay", [1, 3])
def test_it_stays_with_its_way_where_replaced_answers_jump_to_the_other(trained: Checkpoint, delay: int) -> None:
    apart = [Ran(trained, Replaced(runner("diffusion")), delay, number) for number in range(20)]
    joined = [Ran(trained, Continuing(runner("diffusion")), delay, number) for number in range(20)]
    assert all(each.waited == 0 for each in (*apart, *joined))
    for each in joined:
        for plan, answer in each.plans[1:]:
            assert plan is not None
            assert plan.frozen == delay
            # The property: what is carried out meanwhile is what the answer begins with.
            assert answer[:delay] == pytest.approx(plan.ahead[:delay], abs=1e-5)
    jumps = np.mean([each.jump() for each in joined]), np.mean([each.jump() for each in apart])
    changed = sum(each.changes() for each in joined), sum(each.changes() for each in apart)
    print(f"answers in {delay} periods: jump {jumps[0]:.3f}, {jumps[1]:.3f} rad; changed sides {changed} of 20")
    assert jumps[0] < jumps[1] / 2
    assert changed[1] >= 5, "a replaced answer goes round the other side"
    assert changed[0] <= changed[1] / 3


@pytest.mark.medium
def test_an_answer_keeps_frozen_steps_and_is_free_where_nothing_is_known(tmp_path: Path) -> None:
    made = learn(tmp_path, episodes.small(4), history=2)
    predict = runner("diffusion").predict(made, BUNDLE)
    inputs = {
        name: np.zeros((1, 2, 1, size), np.float32) for name, size in (("joints", 3), ("objects", 9), ("goal", 1))
    }
    free = predict.continued(inputs, 3, None)
    assert free.shape == (7, 3)
    assert free[:4] == pytest.approx(predict(inputs, 3), abs=1e-6), "the steps that are executed come first"
    nothing = Plan(np.zeros((0, 3)), np.zeros((0, 3)), 1)
    assert predict.continued(inputs, 3, nothing) == pytest.approx(free, abs=1e-5)
    low, high = (np.array(made.contract.action.mean) + side * np.array(made.contract.action.scale) for side in (-1, 1))
    ahead = low + np.linspace(0.3, 0.7, 5)[:, None] * (high - low)
    plan = Plan(ahead[:1].repeat(40, axis=0), ahead, 2)
    found = predict.continued(inputs, 3, plan)
    assert found[:2] == pytest.approx(ahead[:2], abs=1e-5)
    off = np.abs(found[:5] - ahead).max(axis=1)
    apart = np.abs(free[:5] - ahead).max(axis=1)
    assert (off[2:] < apart[2:]).all(), "steps after them are drawn towards the plan"
    assert off[4] > 1e-4, "the farther ahead, the less"


def test_the_soft_mask_is_that_of_the_paper() -> None:
    plan = Plan(np.zeros((0, 1)), np.zeros((7, 1)), 2)
    share = np.array([5, 4, 3, 2, 1]) / 6
    assert plan.weights() == pytest.approx([1, 1, *(share * (np.exp(share) - 1) / (np.e - 1))])
    assert (np.diff(plan.weights()) <= 0).all()
    assert Plan(np.zeros((0, 1)), np.zeros((2, 1)), 5).weights().tolist() == [1.0, 1.0]


def test_a_policy_that_cannot_continue_is_one_clear_error() -> None:
    with pytest.raises(RuleError, match="`act` cannot continue what is carried out") as raised:
        policies.load(Continuing(runner("act")), checkpoint(contract(BUNDLE)), BUNDLE)
    assert "--asynchronous" in str(raised.value.hint)

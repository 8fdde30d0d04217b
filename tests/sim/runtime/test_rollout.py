"""One episode at a time: closed loop, open loop, and that nothing is left of the episode before."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.policy.cameras import PICTURE
from dextera_build.policy.observation import Frame
from dextera_build.policy.running import PolicyFault
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.rollout import closed_loop, open_loop
from tests import gate


class Constant:
    """Says the same target at all times, and counts."""

    def __init__(self, goal: float, fault: int | None = None) -> None:
        self.goal, self.fault = goal, fault
        self.resets = self.steps = 0
        self.seen = []

    def reset(self):
        self.resets += 1
        self.steps = 0

    def act(self, observation):
        self.steps += 1
        self.seen.append(observation)
        if self.steps == self.fault:
            raise PolicyFault("the policy gave NaN", code="DXB-B511")
        return np.array([gate.target(self.goal)])


@pytest.fixture(scope="module")
def environment():
    return Environment(gate.bundle())


def drawn(environment, seed=0):
    return environment.draw(seed)


def test_a_policy_that_pushes_succeeds_and_one_that_stops_short_does_not(environment):
    done = closed_loop(environment, Constant(gate.PUSHES), drawn(environment))
    assert (done.success, done.reason, done.origin) == (True, "", "policy")
    late = closed_loop(environment, Constant(gate.STOPS_SHORT), drawn(environment))
    assert (late.success, late.reason) == (False, "not done within 3 s: a joint is not at its command")
    assert len(late.action) == 60


def test_it_sees_the_joints_and_what_was_sent_before(environment):
    policy = Constant(gate.PUSHES)
    episode = closed_loop(environment, policy, drawn(environment))
    assert np.array([seen["joints"] for seen in policy.seen]) == pytest.approx(episode.joints)
    sent = np.array([seen["previous_action"] for seen in policy.seen])
    assert sent[1:] == pytest.approx(episode.executed[:-1])
    assert policy.seen[0].rgb is None


def test_the_picture_is_of_the_moment(environment):
    policy, count = Constant(gate.PUSHES), iter(range(100))
    look = lambda: {PICTURE: Frame(np.full((2, 2, 3), next(count), np.uint8))}  # noqa: E731
    episode = closed_loop(environment, policy, drawn(environment), look)
    assert [int(seen.rgb[0, 0, 0]) for seen in policy.seen] == list(range(len(episode.action)))


@pytest.mark.parametrize("step", [1, 5])
def test_a_fault_of_the_policy_fails_the_trial_alone(environment, step):
    policy = Constant(gate.PUSHES, fault=step)
    failed = closed_loop(environment, policy, drawn(environment))
    assert (failed.success, failed.reason, len(failed.action)) == (False, "the policy gave NaN", step - 1)
    policy.fault = None
    assert closed_loop(environment, policy, drawn(environment)).success
    assert policy.resets == 2


def test_an_episode_does_not_depend_on_the_one_before(environment):
    first = closed_loop(environment, Constant(gate.PUSHES), drawn(environment, 1))
    closed_loop(environment, Constant(gate.STOPS_SHORT), drawn(environment, 2))
    again = closed_loop(environment, Constant(gate.PUSHES), drawn(environment, 1))
    for name in ("joints", "objects", "displacement", "executed", "contact"):
        assert np.array_equal(getattr(first, name), getattr(again, name))


def test_what_was_sent_does_the_same_again(environment):
    done = closed_loop(environment, Constant(gate.PUSHES), drawn(environment))
    again = open_loop(environment, done.start, done.executed)
    assert again.success
    assert again.origin == "replay"
    assert again.joints == pytest.approx(done.joints, abs=1e-5)


def test_the_last_target_is_held_while_the_verdict_takes_its_time(environment):
    done = closed_loop(environment, Constant(gate.PUSHES), drawn(environment))
    cut = done.executed[:-4]
    assert open_loop(environment, done.start, cut, linger_s=0.4).success
    short = open_loop(environment, done.start, cut, linger_s=0.0)
    assert (short.success, short.reason) == (False, "not done when the trajectory was over")
    assert len(short.action) == len(cut)

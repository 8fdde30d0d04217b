"""Policies at run time."""

from __future__ import annotations

import dataclasses
import typing

import numpy as np
import pytest

from dextera_build.errors import RuleError
from dextera_build.learning import weights
from dextera_build.policy import layout
from dextera_build.policy.features import Fields
from dextera_build.policy.observation import DeployableObservation
from dextera_build.policy.running import Ensemble, Policy, PolicyFault
from tests import episodes
from tests.policy import policies
from tests.policy.policies import load

BUNDLE = episodes.bundle()


def scripted(chunks: list[np.ndarray], **settings: float) -> Policy:
    """A policy whose network gives these chunks, one after another."""
    contract = policies.contract(BUNDLE, **settings)
    left = iter(chunks)

    def predict(inputs: Fields, step: int) -> np.ndarray:
        return next(left)

    limits = np.array([(joint.lower, joint.upper) for joint in BUNDLE.robot.joints])
    return Policy(contract, layout.of_bundle(BUNDLE), predict, limits)


def test_a_checkpoint_becomes_a_policy_that_gives_joint_targets():
    policy = load(policies.checkpoint(policies.contract(BUNDLE)), BUNDLE)
    action = policy.act(policies.observation())
    assert action.shape == (3,)
    assert action.dtype == np.float64
    assert np.isfinite(action).all()


def test_the_same_observations_give_the_same_actions_after_a_reset():
    policy = load(policies.checkpoint(policies.contract(BUNDLE)), BUNDLE)
    seen = [policies.observation(step) for step in range(8)]
    first = [policy.act(one) for one in seen]
    policy.reset()
    np.testing.assert_array_equal(first, [policy.act(one) for one in seen])


def test_what_was_predicted_before_counts_until_a_reset():
    chunks = [np.full((2, 3), 0.1), np.full((2, 3), 0.3), np.full((2, 3), 0.5)]
    policy = scripted(chunks, forget=0.0)
    assert policy.act(policies.observation())[0] == pytest.approx(0.1)
    assert policy.act(policies.observation())[0] == pytest.approx(0.2)
    policy.reset()
    assert policy.act(policies.observation())[0] == pytest.approx(0.5)


def test_overlapping_chunks_are_weighed_oldest_first():
    ensemble = Ensemble(every=1, forget=0.7)
    ensemble.add(np.array([[1.0], [2.0]]))
    assert ensemble.take() == pytest.approx(1.0)
    ensemble.add(np.array([[4.0], [8.0]]))
    old, new = 1.0, np.exp(-0.7)
    assert ensemble.take() == pytest.approx((2.0 * old + 4.0 * new) / (old + new))


def test_a_policy_with_a_history_sees_the_latest_observations_and_the_step():
    contract = policies.contract(BUNDLE, history=3)
    seen, steps = list[np.ndarray](), list[int]()

    def predict(inputs: Fields, step: int) -> np.ndarray:
        seen.append(inputs["joints"])
        steps.append(step)
        return np.zeros((1, 3))

    limits = np.array([(joint.lower, joint.upper) for joint in BUNDLE.robot.joints])
    policy = Policy(contract, layout.of_bundle(BUNDLE), predict, limits)
    for step in range(4):
        policy.act(policies.observation(step))
    one = seen[0][:, -1]
    assert steps == [0, 1, 2, 3]
    assert all(each.shape == (1, 3, *one.shape[1:]) for each in seen)
    np.testing.assert_array_equal(seen[0], np.stack([one] * 3, axis=1))
    newest = [each[:, -1] for each in seen]
    np.testing.assert_array_equal(seen[1], np.stack([one, one, newest[1]], axis=1))
    np.testing.assert_array_equal(seen[3], np.stack(newest[1:], axis=1))
    assert not np.array_equal(newest[1], newest[2])
    policy.reset()
    policy.act(policies.observation(3))
    assert steps[-1] == 0
    np.testing.assert_array_equal(seen[-1], np.stack([newest[3]] * 3, axis=1))


def test_a_chunk_can_be_carried_out_before_the_next_is_asked_for():
    policy = scripted([np.arange(12.0).reshape(4, 3) / 100, np.ones((4, 3))], every=4)
    acted = [policy.act(policies.observation()) for _ in range(5)]
    np.testing.assert_allclose(acted[:4], np.arange(12.0).reshape(4, 3) / 100)
    np.testing.assert_allclose(acted[4], 1.0)


def test_a_chunk_shorter_than_the_pause_is_followed_by_the_next():
    policy = scripted([np.zeros((1, 3)), np.ones((1, 3))], every=10)
    assert [policy.act(policies.observation())[0] for _ in range(2)] == [0.0, 1.0]


def test_actions_stay_within_joint_limits():
    policy = scripted([np.full((1, 3), 100.0)], every=1)
    np.testing.assert_array_equal(policy.act(policies.observation()), [2.5, 1.5, 2.2])


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_what_is_not_finite_never_reaches_the_robot(bad: float):
    policy = scripted([np.zeros((1, 3))] * 2 + [np.full((1, 3), bad)])
    policy.act(policies.observation())
    policy.act(policies.observation())
    with pytest.raises(PolicyFault, match=r"^the policy gave NaN at step 2$"):
        policy.act(policies.observation())


def test_an_observation_that_is_not_finite_is_named():
    policy = load(policies.checkpoint(policies.contract(BUNDLE)), BUNDLE)
    with pytest.raises(PolicyFault, match=r"^the policy was given NaN in `joints` at step 0$"):
        policy.act(policies.observation(joints=np.array([0.0, np.nan, 0.0])))


def test_pictures_are_needed_by_policies_that_look_and_by_no_others():
    view = episodes.view()
    policy = load(policies.checkpoint(policies.contract(BUNDLE, ("joints", "rgb"), view)), BUNDLE, view)
    picture = np.full((48, 64, 3), 128, np.uint8)
    dark = policy.act(policies.observation(rgb=picture * 0))
    policy.reset()
    assert not np.array_equal(dark, policy.act(policies.observation(rgb=picture)))
    with pytest.raises(PolicyFault, match=r"given no picture at step 1, it needs \(48, 64, 3\)"):
        policy.act(policies.observation())
    with pytest.raises(PolicyFault, match=r"given a picture \(24, 32, 3\) at step 1"):
        policy.act(policies.observation(rgb=picture[::2, ::2]))


def test_a_policy_cannot_be_given_what_only_a_simulator_knows():
    hints = typing.get_type_hints(Policy.act)
    assert hints["observation"] is DeployableObservation
    shown = policies.observation().values
    assert {channel.name for channel in policies.contract(BUNDLE).inputs} <= shown.keys()
    with pytest.raises(TypeError, match=r"policies may not see \['contact'\]"):
        DeployableObservation({**shown, "contact": np.zeros((2, 3))})


def test_privileged_quantities_full_of_nan_change_nothing():
    """Even smuggled into the object that a policy gets, they are not looked at."""

    @dataclasses.dataclass(frozen=True)
    class Smuggled(DeployableObservation):
        contact: np.ndarray = dataclasses.field(default_factory=lambda: np.full((2, 3), np.nan))
        joint_velocities: np.ndarray = dataclasses.field(default_factory=lambda: np.full(3, np.nan))

    made = policies.checkpoint(policies.contract(BUNDLE))
    clean = policies.observation()
    poisoned = Smuggled(**vars(clean))
    np.testing.assert_array_equal(load(made, BUNDLE).act(clean), load(made, BUNDLE).act(poisoned))


def test_a_checkpoint_for_another_task_does_not_load():
    with pytest.raises(RuleError, match="the policy does not fit the task bundle: another rate"):
        load(policies.checkpoint(policies.contract(BUNDLE)), BUNDLE, rate_hz=10.0)


def test_weights_of_another_network_do_not_load():
    made = policies.checkpoint(policies.contract(BUNDLE))
    wider = made.contract.model_copy(update={"settings": made.contract.settings | {"width": 32}})
    with pytest.raises(RuleError, match="the weights do not fit the network that the contract describes"):
        load(made.model_copy(update={"contract": wider}), BUNDLE)


def test_damaged_weights_do_not_load():
    made = policies.checkpoint(policies.contract(BUNDLE))
    with pytest.raises(RuleError, match="the weights are not a safetensors file"):
        load(made.model_copy(update={"weights": b"\x80\x04N."}), BUNDLE)


def test_nan_weights_do_not_load():
    made = policies.checkpoint(policies.contract(BUNDLE))
    tensors = weights.from_bytes(made.weights)
    tensors["head.bias"][0] = float("nan")
    with pytest.raises(RuleError, match="do not fit the network") as caught:
        load(made.model_copy(update={"weights": weights.to_bytes(tensors)}), BUNDLE)
    assert caught.value.facts == {"not finite": "head.bias"}

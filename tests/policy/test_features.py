"""From observations to inputs, in training and at run time."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import quaternions
from dextera_build.policy import contract as contracts
from dextera_build.policy import features, layout, normalisation
from dextera_build.policy.features import Reader
from dextera_build.policy.observation import Measurement, deployable
from tests import episodes, factories

BUNDLE = episodes.bundle()
HERE = layout.of_bundle(BUNDLE)


def test_the_previous_action_is_what_was_sent_before():
    one = episodes.episode()
    sent = features.recorded(one)["previous_action"]
    np.testing.assert_array_equal(sent[0], one.start.ctrl.astype(np.float32))
    np.testing.assert_array_equal(sent[1:], one.executed[:-1])
    assert not np.array_equal(sent[1:], one.action[:-1])


def test_an_episode_reads_as_its_observations_did():
    one = episodes.episode()
    reader = Reader(tuple(contracts.channel(HERE, name) for name in contracts.VECTORS), HERE)
    whole = reader.read(features.recorded(one))
    before = one.start.ctrl
    for step in range(len(one.action)):
        seen = Measurement(one.joints[step], one.objects[step], one.displacement[step])
        live = reader.read(features.observed(deployable(seen, before, one.goal)))
        before = one.executed[step]
        for name, inputs in whole.items():
            np.testing.assert_array_equal(live[name][0], inputs[step], err_msg=f"{name} at step {step}")


def test_objects_are_a_token_each():
    channel = contracts.channel(HERE, "objects")
    assert features.tokens(channel) == (2, 9)
    assert Reader((channel,), HERE).read(features.recorded(episodes.episode(5)))["objects"].shape == (5, 2, 9)
    assert features.tokens(contracts.channel(HERE, "joints")) == (1, 3)


def test_components_are_picked_by_name():
    fields = features.recorded(episodes.episode(5))
    case = contracts.channel(HERE, "objects", only=("case",))
    read = Reader((case,), HERE).read(fields)["objects"]
    np.testing.assert_array_equal(read[:, 0, :3], fields["objects"][:, 1, :3])


def test_opposite_quaternions_are_the_same_input():
    turn = np.random.default_rng(0).normal(size=(50, 4))
    np.testing.assert_array_equal(features.rotation_columns(turn), features.rotation_columns(-turn))


def test_rotations_are_the_columns_of_their_matrix():
    for yaw in np.linspace(-3, 3, 7):
        matrix = factories.pose(yaw=yaw)[:3, :3]
        columns = features.rotation_columns(quaternions.from_matrix(matrix))
        np.testing.assert_allclose(columns, matrix[:, :2].T.ravel(), atol=1e-12)


def test_normalised_training_data_have_mean_0_and_deviation_1():
    samples = np.random.default_rng(0).normal(3.0, 0.5, (1000, 1, 3)).astype(np.float32)
    fitted = normalisation.fitted(contracts.channel(HERE, "joints"), [samples])
    normal = features.normalised(fitted, samples)
    np.testing.assert_allclose(normal.mean(axis=0), 0, atol=1e-5)
    np.testing.assert_allclose(normal.std(axis=0), 1, atol=1e-5)


def test_what_hardly_moves_is_not_magnified():
    still = np.random.default_rng(0).normal(1.0, 1e-6, (100, 1, 3)).astype(np.float32)
    fitted = normalisation.fitted(contracts.channel(HERE, "joints"), [still])
    assert fitted.scale == (float(np.float32(normalisation.FLOOR)),) * 3


def test_a_mixture_is_weighed_by_its_shares_and_not_by_its_sizes():
    many, few = np.zeros((300, 1, 3)), np.ones((30, 1, 3))
    fitted = normalisation.fitted(contracts.channel(HERE, "joints"), [many, few])
    np.testing.assert_allclose(fitted.mean, 0.5)
    np.testing.assert_allclose(fitted.scale, 0.5)
    third = normalisation.fitted(contracts.channel(HERE, "joints"), [many, few], weights=[2, 1])
    np.testing.assert_allclose(third.mean, 1 / 3, rtol=1e-6)

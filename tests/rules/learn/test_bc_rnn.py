"""learn.bc_rnn: that it remembers, keeps ways apart, is exact, and that an interruption loses nothing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scipy.stats import norm

from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.errors import RuleError
from dextera_build.learning import weights
from dextera_build.learning.samples import Batch
from dextera_build.policy.cameras import PICTURE
from dextera_build.policy.observation import Frame, Measurement, deployable
from tests import episodes
from tests.policy.policies import contract, load, runner
from tests.rules.learn.trainings import BUNDLE, FEW, Trainings, changed, filmed, miss

SEEN = {"inputs": ("objects",), "steps": 150, "batch": 32, "rate": 1e-2, "warm_up": 10, "held_out": 0.0}
RNN = Trainings("learn.bc_rnn", SEEN | {"hidden": 24, "layers": 1, "least_std": 0.2})
ACT = Trainings("learn.act", SEEN | {"width": 16, "heads": 2, "chunk": 1})
SWING = Trainings(
    "learn.bc_rnn",
    {"steps": 30, "hidden": 16, "horizon": 5, "batch": 16, "rate": 1e-2, "warm_up": 3, "held_out": 0.25},
)
STEPS, CUE = 10, 3
"""Steps of an episode, and the first of these in which is seen what the action depends on."""
learn = SWING.learn


def remembered() -> Episodes:
    """Joint 1 goes to 0.5 or -0.5 rad; where the box is before step `CUE` tells which, afterwards it does not."""
    sides = np.tile([1.0, -1.0], 4)[:, None]
    places = np.where(np.arange(STEPS) < CUE, 0.4 + 0.05 * sides, 0.4)
    return changed(8, STEPS, 0.5 * sides * np.ones(STEPS), places)


def sent(made: Checkpoint, data: Episodes, name: str, steps: int = STEPS) -> np.ndarray:
    """Targets (steps, 3) [rad] for what is seen in an episode, which is held at its last step."""
    policy, one = load(made, BUNDLE), data.items[name]
    acted = []
    for step in range(steps):
        row = min(step, len(one.objects) - 1)
        seen = Measurement(one.joints[row], one.objects[row], one.displacement[row])
        acted.append(policy.act(deployable(seen, one.start.ctrl, one.goal)))
    return np.array(acted)


@pytest.mark.medium
def test_it_remembers_what_was_seen_earlier_in_the_horizon(tmp_path: Path) -> None:
    data = remembered()
    made = RNN.learn(tmp_path, data, horizon=STEPS)
    late = [sent(made, data, name)[CUE:, 0] for name in ("0", "1")]
    np.testing.assert_allclose(late, np.array([0.5, -0.5])[:, None] * np.ones(STEPS - CUE), atol=0.1)


@pytest.mark.slow
def test_a_policy_without_memory_cannot_learn_it(tmp_path: Path) -> None:
    """Which shows that the test above asks for memory."""
    data = remembered()
    made = ACT.learn(tmp_path, data)
    first, second = (sent(made, data, name)[:, 0] for name in ("0", "1"))
    assert first[0] > 0.3 > -0.3 > second[0], "it learned what it sees"
    np.testing.assert_allclose(first[CUE:], second[CUE:], atol=1e-6)


@pytest.mark.parametrize("least_std", [1e-4, 0.1])
def test_narrow_gaussians_are_exact_in_a_training_of_bfloat16(
    least_std: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The likelihood of what a network gives, of whose parts only the LSTM rounds to bfloat16."""
    module = runner("bc_rnn").network
    network = module.BcRnn(module.Sizes(hidden=64, least_std=least_std), contract(BUNDLE, ("joints",)))
    read = torch.randn(16, 10, 64, generator=torch.Generator().manual_seed(0)).tanh().bfloat16()
    monkeypatch.setattr(
        network.lstm, "forward", lambda *_: (read if torch.is_autocast_enabled("cpu") else read.float(), None)
    )
    with torch.no_grad():
        network.spreads.weight.zero_()
        network.spreads.bias.fill_(-12.0)  # all but the least
        inputs = {"joints": torch.zeros(16, 10, 1, 3)}
        batch = Batch(inputs, network(inputs)[0].likeliest(), torch.ones(16, 10, dtype=torch.bool))
        exact = float(module.loss_of(network, batch)[0])
        with torch.autocast("cpu", torch.bfloat16):
            fast = float(module.loss_of(network, batch)[0])
    assert fast == pytest.approx(exact, abs=1e-5)


def test_it_forgets_at_the_horizon_and_at_the_start_of_an_episode(tmp_path: Path) -> None:
    data = episodes.small(4)
    policy = load(learn(tmp_path, data), BUNDLE)
    one = data.items["0"]

    def act(row: int) -> np.ndarray:
        seen = Measurement(one.joints[row], one.objects[row], one.displacement[row])
        return policy.act(deployable(seen, one.start.ctrl, one.goal))

    fresh = act(9)
    policy.reset()
    seen = [act(row) for row in (0, 9, 3, 4, 5)]
    assert not np.array_equal(seen[1], fresh), "it remembers step 0"
    np.testing.assert_array_equal(act(9), fresh)  # step 5 is the first of a new horizon
    act(3)
    policy.reset()
    np.testing.assert_array_equal(act(9), fresh)


@pytest.mark.slow
def test_ways_that_were_shown_are_kept_apart(tmp_path: Path) -> None:
    """Seeing the same, half of the demonstrations go to 0.5 rad and half to -0.5 rad; none goes between."""
    data = changed(8, STEPS, 0.5 * np.tile([1.0, -1.0], 4)[:, None] * np.ones(STEPS), np.full((8, STEPS), 0.4))
    made = RNN.learn(tmp_path, data, pick="drawn")
    drawn = sent(made, data, "0", 40)[:, 0]
    assert np.abs(np.abs(drawn) - 0.5).max() < 0.05
    assert 10 < (drawn > 0).sum() < 30, "each as often as it was shown"
    np.testing.assert_array_equal(drawn, sent(made, data, "0", 40)[:, 0])
    picked = sent(RNN.learn(tmp_path, data, pick="likeliest"), data, "0", 40)[:, 0]
    assert np.abs(np.abs(picked) - 0.5).max() < 0.05


@pytest.mark.medium
def test_targets_far_from_the_mean_are_reached(tmp_path: Path) -> None:
    """One step in ten goes to 1 rad, three standard deviations from the mean; a bound of -1..1 would cut it off."""
    at = np.arange(STEPS)
    data = changed(4, STEPS, np.tile(at == 4, (4, 1)).astype(float), np.tile(0.4 + 0.1 * (at == 4), (4, 1)))
    made = RNN.learn(tmp_path, data)
    action = made.contract.action
    assert (1.0 - action.mean[0]) / action.scale[0] == pytest.approx(3.0, abs=0.01)
    np.testing.assert_allclose(sent(made, data, "0")[:, 0], at == 4, atol=0.1)


def test_the_loss_is_the_negative_log_likelihood_of_valid_steps() -> None:
    network = runner("bc_rnn").network
    rng = np.random.default_rng(0)
    logits, means = rng.normal(size=(2, 3, 4)), rng.normal(size=(2, 3, 4, 5))
    stds, actions = rng.uniform(0.2, 2.0, (2, 3, 4, 5)), rng.normal(size=(2, 3, 5))
    keep = np.array([[True, True, True], [True, False, False]])
    shares = np.exp(logits) / np.exp(logits).sum(axis=-1, keepdims=True)
    density = (shares * norm.pdf(actions[:, :, None], means, stds).prod(axis=-1)).sum(axis=-1)
    modes = network.Modes(*(torch.from_numpy(each) for each in (logits, means, stds)))
    batch = Batch({}, torch.from_numpy(actions), torch.from_numpy(keep))

    class Fixed:
        locate = None

        def see(self, inputs: object) -> None: ...

        def __call__(self, inputs: object, seen: object) -> tuple[Any, None]:
            return modes, None

    loss, shown = network.loss_of(Fixed(), batch)
    assert float(loss) == pytest.approx(-np.log(density[keep]).mean() / 5)
    assert float(shown) == float(loss)


def test_standard_deviations_have_a_floor() -> None:
    network = runner("bc_rnn").network
    made = network.BcRnn(network.Sizes(hidden=8, least_std=0.25), contract(BUNDLE, ("joints",)))
    with torch.no_grad():
        made.spreads.bias.fill_(-1e4)
        modes, _ = made({"joints": torch.zeros(1, 4, 1, 3)})
    assert torch.equal(modes.stds, torch.full((1, 4, 5, 3), 0.25))


def test_steps_one_by_one_are_the_whole_window() -> None:
    network = runner("bc_rnn").network
    made = network.BcRnn(network.Sizes(hidden=8), contract(BUNDLE, ("joints",)))
    seen, state = torch.randn(1, 6, 1, 3), None
    whole, _ = made({"joints": seen})
    for step in range(6):
        one, state = made({"joints": seen[:, step : step + 1]}, state)
        torch.testing.assert_close(one.means[:, 0], whole.means[:, step])


@pytest.mark.slow
def test_it_learns_what_was_shown(tmp_path: Path) -> None:
    """A policy that saw 16 swings towards a box reaches boxes that stand elsewhere."""
    made = learn(tmp_path, episodes.small(16, 30), steps=600, hidden=64, batch=32, horizon=10, rate=3e-3)
    assert made.curve[-1] < made.curve[0] - 2.0
    assert miss(made) < 0.1


@pytest.mark.medium
def test_the_same_inputs_give_the_same_bytes(tmp_path: Path) -> None:
    data = episodes.small(4)
    first = learn(tmp_path, data)
    assert learn(tmp_path, data).weights == first.weights
    assert learn(tmp_path, data, seed=1).weights != first.weights


@pytest.mark.medium
@pytest.mark.parametrize("more", [{"average": 0.9}, {"inputs": ("joints", "rgb"), "steps": 12}])
def test_a_training_that_was_killed_ends_with_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, more: dict[str, Any]
) -> None:
    SWING.assert_resumes(tmp_path, monkeypatch, **more)


@pytest.mark.medium
def test_it_learns_from_pictures(tmp_path: Path) -> None:
    data = episodes.small(4)
    made = learn(tmp_path, data, inputs=("joints", "rgb"), film=filmed(data))
    assert made.curve[-3:].mean() < made.curve[0] - 0.5
    assert {"eyes", "locate"} <= {name.partition(".")[0] for name in weights.from_bytes(made.weights)}
    policy = load(made, BUNDLE, episodes.view(48, 32))
    joints, frames = data.items["0"].joints[0], np.zeros((2, 32, 48, 3), np.uint8)
    frames[1, 8:16, 8:16] = 255
    seen = [Measurement(joints, np.zeros((2, 7)), np.zeros(1), {PICTURE: Frame(rgb=one)}) for one in frames]
    acted = []
    for one in seen:
        policy.reset()
        acted.append(policy.act(deployable(one, joints, np.ones(1))))
    assert not np.array_equal(*acted)


def test_the_stub_gives_a_checkpoint_of_the_same_form(tmp_path: Path) -> None:
    data = episodes.small(4)
    stub, real = (learn(tmp_path, data, backend=backend, **FEW) for backend in ("stub", "torch"))
    assert stub.contract == real.contract
    assert stub.curve_name == real.curve_name == "negative log-likelihood"
    with pytest.raises(RuleError, match="the weights do not fit the network"):
        load(stub, BUNDLE)

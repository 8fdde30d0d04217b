"""learn.diffusion: what it learns, that it is exact, and that an interruption loses nothing."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor
from torch._subclasses.fake_tensor import FakeTensorMode

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.tasks.episode import Episode, Episodes, Film
from dextera_build.artifacts.tasks.pixels import Pixels
from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.errors import RuleError
from dextera_build.learning.demonstrations import Selection, prepare
from dextera_build.learning.parts import parts_of
from dextera_build.learning.samples import Batch, Samples
from dextera_build.recipe import profiles
from dextera_build.testing import RuleRunner
from tests import episodes
from tests.policy.policies import load, observation, runner
from tests.rules.learn.test_mixture import elsewhere, mixed
from tests.rules.learn.trainings import BUNDLE, Trainings, filmed, miss

BOTH = pytest.mark.parametrize("network", ["unet", "transformer"])
NETWORK = runner("diffusion").network
SIZES = {"width": 8, "levels": 2, "layers": 1, "heads": 2, "horizon": 8, "every": 4, "denoisings": 2}
DIFFUSION = Trainings("learn.diffusion", SIZES | {"steps": 12, "batch": 8, "held_out": 0.25, "warm_up": 1})
learn = DIFFUSION.learn
SIDE_RAD = 0.5
"""How far the first joint turns to either side."""


@pytest.mark.slow
@pytest.mark.parametrize("predicts", ["sample", "noise"])
@BOTH
def test_it_learns_what_was_shown(tmp_path: Path, network: str, predicts: str) -> None:
    """A policy that saw 16 swings towards a box reaches boxes that stand elsewhere."""
    sizes: dict[str, Any] = {"width": 32, "batch": 32, "warm_up": 50, "denoisings": 10, "predicts": predicts}
    made = learn(tmp_path, episodes.small(16, 30), steps=600, network=network, **sizes)
    assert made.curve[-1] < 0.2 * made.curve[0]
    assert miss(made) < 0.1


def sides(count: int) -> Episodes:
    """Episodes from one start in which the first joint turns left or right, which nothing observed foretells."""

    def turned(one: Episode, side: float) -> Episode:
        home = np.tile(np.array(episodes.HOME, np.float32), (2, 1))
        there = home + np.array([side * SIDE_RAD, 0.0, 0.0], np.float32)
        joints = np.concatenate([home[:1], there[1:]])
        return episodes.observed(one, joints=joints).model_copy(update={"action": there, "executed": there})

    made = episodes.small(count, 2)
    signs = np.random.default_rng(0).permutation(np.repeat([-1.0, 1.0], count // 2))
    pairs = zip(made.items.items(), signs, strict=True)
    return made.model_copy(update={"items": {name: turned(one, sign) for (name, one), sign in pairs}})


def first_turns(made: Checkpoint, tries: int = 40) -> np.ndarray:
    """Executed targets (tries, steps) of the first joint [rad] in predictions from the start of `sides`."""
    joints = made.contract.inputs[0]
    start = ((np.array(episodes.HOME) - np.array(joints.mean)) / np.array(joints.scale)).astype(np.float32)
    inputs = {"joints": np.tile(start, (1, 2, 1, 1))}
    predict = runner("diffusion").predict(made, BUNDLE)
    return np.array([predict(inputs, step)[:, 0] for step in range(tries)])


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [
        {"network": "unet", "steps": 800, "batch": 32, "rate": 2e-3},
        {"network": "transformer", "steps": 1500, "batch": 64, "rate": 2e-3, "layers": 2},
    ],
    ids=["unet", "transformer"],
)
def test_it_does_one_of_two_things_and_not_their_average(tmp_path: Path, options: dict[str, Any]) -> None:
    data = sides(32)
    made = learn(tmp_path, data, inputs=("joints",), held_out=0.0, width=32, warm_up=50, denoisings=10, **options)
    shown = np.array([one.action[0, 0] for one in data.items.values()])
    np.testing.assert_allclose(np.abs(shown), SIDE_RAD)
    assert abs(shown.mean()) < 1e-6, "the average is to go nowhere"
    turns = first_turns(made)
    assert np.median(np.abs(np.abs(turns) - SIDE_RAD)) < 0.2 * SIDE_RAD
    assert np.mean(np.abs(turns) > SIDE_RAD / 2) > 0.9, "closer to a side than to the average"
    assert 0.2 < np.mean(turns[:, 0] > 0) < 0.8
    assert np.mean(np.ptp(np.sign(turns), axis=1) == 0) > 0.9, "a window stays with its way"


@pytest.mark.medium
@BOTH
def test_the_same_inputs_give_the_same_bytes(tmp_path: Path, network: str) -> None:
    data = episodes.small(4)
    first = learn(tmp_path, data, network=network, dropout=0.1)
    torch.manual_seed(7)
    state = torch.get_rng_state()
    assert learn(tmp_path, data, network=network, dropout=0.1).weights == first.weights
    assert torch.equal(torch.get_rng_state(), state)
    assert learn(tmp_path, data, network=network, dropout=0.1, seed=1).weights != first.weights


@pytest.mark.medium
@pytest.mark.parametrize(
    "more",
    [
        pytest.param({}, marks=pytest.mark.slow),
        {"average": 0.0},
        {"network": "transformer", "dropout": 0.2},
        pytest.param({"inputs": ("joints", "rgb")}, marks=pytest.mark.slow),
    ],
)
def test_a_training_that_was_killed_ends_with_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, more: dict[str, Any]
) -> None:
    DIFFUSION.assert_resumes(tmp_path, monkeypatch, **more)


@pytest.mark.medium
@BOTH
def test_a_trial_repeats_and_every_step_has_other_noise(tmp_path: Path, network: str) -> None:
    policy = load(learn(tmp_path, episodes.small(4), network=network), BUNDLE)
    first = [policy.act(observation()) for _ in range(9)]
    policy.reset()
    again = [policy.act(observation()) for _ in range(9)]
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first[0], first[4])
    policy.reset()
    policy.act(observation(3))
    other = policy.act(observation(3))
    assert not np.array_equal(other, first[1])


def test_every_trial_has_noise_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A trial is told by what it begins with; what differs by less than processors do is the same."""
    made = learn(tmp_path, episodes.small(4))
    module = runner("diffusion")
    monkeypatch.setattr(module.network.Denoiser, "sample", lambda _, inputs, noise: noise)
    targets = module.predict(made, BUNDLE)

    def noise(joint: float) -> np.ndarray:
        """At steps 0 and 4 of a trial that begins at a normalised joint position."""
        return np.array(
            [targets({"joints": np.full((1, 2, 1, 3), at, np.float32)}, step) for step, at in ((0, joint), (4, 1))]
        )

    first = noise(0.5)
    np.testing.assert_array_equal(noise(0.5), first)
    np.testing.assert_array_equal(noise(0.5 + 1e-6), first)
    other = noise(0.51)
    assert not np.isclose(other, first).any(), "neither at its start nor later, where it sees the same"
    assert not np.isclose(first[0], first[1]).any()


@pytest.mark.medium
def test_the_executed_steps_begin_at_the_present_one(tmp_path: Path) -> None:
    """The window begins at the oldest observed step, so its first steps are past."""
    made = learn(tmp_path, episodes.small(4), history=3, every=4)
    module = runner("diffusion")
    action = made.contract.action
    window = torch.arange(8.0)[None, :, None].expand(1, 8, 3)
    inputs = {"joints": np.zeros((1, 3, 1, 3), np.float32)}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module.network.Denoiser, "sample", lambda *_: window)
        targets = module.predict(made, BUNDLE)(inputs, 0)
    normalised = (targets - np.array(action.mean)) / np.array(action.scale)
    np.testing.assert_allclose(normalised, np.tile(np.arange(2.0, 6.0)[:, None], 3), atol=1e-6)


@pytest.mark.medium
def test_actions_stay_within_those_of_the_training(tmp_path: Path) -> None:
    """However the network answers: its range is that of the demonstrations, and not one of normalised numbers."""
    data = episodes.small(4)
    made = learn(tmp_path, data, held_out=0.0, denoisings=5)
    action = made.contract.action
    shown = np.concatenate([one.action for one in data.items.values()])
    predict = runner("diffusion").predict(made, BUNDLE)
    rng = np.random.default_rng(0)
    sizes = {"joints": 3, "objects": 9, "goal": 1}
    wild = {name: rng.normal(0, 50, (1, 2, 1, size)).astype(np.float32) for name, size in sizes.items()}
    targets = np.concatenate([predict(wild, step) for step in range(5)])
    # A component that hardly moves has the floor of its scale as half of its range.
    reach = np.maximum(np.ptp(shown, axis=0) / 2, action.scale)
    centre = (shown.min(axis=0) + shown.max(axis=0)) / 2
    assert (np.abs(targets - centre) <= reach + 1e-5).all()


def answers(body: Any, change: str, step: int) -> list[bool]:
    """For each of 8 steps, whether the noise that a network finds in it changes with an action or an observation."""
    random = torch.Generator().manual_seed(0)
    given = {"actions": torch.randn(1, 8, 3, generator=random), "observed": torch.randn(1, 2, 5, generator=random)}
    levels = torch.tensor([50])
    with torch.inference_mode():
        first = body(given["actions"], levels, given["observed"])
        given[change][:, step] += 1.0
        second = body(given["actions"], levels, given["observed"])
    return [bool(moved) for moved in ((first - second).abs().amax(dim=2) > 1e-6)[0]]


@BOTH
def test_every_step_sees_all_that_was_observed_and_the_steps_around_it(network: str) -> None:
    """A window whose steps see only earlier ones can begin with one way to do something and end with another."""
    torch.manual_seed(0)
    body = NETWORK.Unet(3, 8, 2, 10)
    if network == "transformer":
        body = NETWORK.Transformer(3, 8, 16, 1, 2, history=2, observed=5, dropout=0.0).eval()
    assert answers(body, "observed", 0) == answers(body, "observed", 1) == [True] * 8
    assert all(answers(body, "actions", 3)[1:6])
    assert all(answers(body, "actions", 7)[5:])


def sample(network: Any, count: int = 2) -> Batch:
    """Samples whose episodes end after the fourth step of the window."""
    keep = torch.tensor([[False, True, True, True, False, False, False, False]]).expand(count, -1)
    inputs = {name: torch.zeros(count, 2, 1, size) for name, size in (("joints", 3), ("objects", 9), ("goal", 1))}
    return Batch({name: inputs[name] for name in network.vectors}, torch.zeros(count, 8, 3), keep)


@pytest.mark.medium
def test_steps_far_after_the_end_are_not_learned(tmp_path: Path) -> None:
    made = learn(tmp_path, episodes.small(4), predicts="noise")
    network = NETWORK.of_contract(made.contract)
    assert NETWORK.trained_on(sample(network).keep, 2)[0].tolist() == [True] * 6 + [False] * 2
    network.requires_grad_(False)
    noise = torch.randn(2, 8, 3, generator=torch.Generator().manual_seed(0)).requires_grad_()
    network.forward = lambda actions, levels, observed: torch.zeros_like(actions)
    loss, _ = NETWORK.loss_of(network, sample(network), noise, torch.tensor([5, 50]), held=2)
    (slope,) = torch.autograd.grad(loss, noise)
    assert (slope[:, 6:] == 0).all()
    assert (slope[:, :6] != 0).all()
    assert float(loss.detach()) == pytest.approx(float(noise.detach()[:, :6].square().mean()))


@pytest.mark.medium
def test_it_learns_from_pictures_and_from_a_mixture(tmp_path: Path) -> None:
    near = episodes.small(3)
    films = Collection[Film | Pixels](items={"twin": filmed(near), "reference": filmed(near)})
    data = mixed(tmp_path, {}, twin=near, reference=elsewhere(near))
    made = learn(tmp_path, data, films=films, inputs=("joints", "world", "rgb"))
    policy = load(made, BUNDLE, episodes.view(48, 32))
    dark = np.zeros((32, 48, 3), np.uint8)
    first = [policy.act(observation(rgb=dark)) for _ in range(5)]
    policy.reset()
    second = [policy.act(observation(rgb=255 - dark)) for _ in range(5)]
    assert np.isfinite(first).all()
    assert not np.array_equal(first, second)


@pytest.mark.medium
def test_the_stub_gives_a_checkpoint_of_the_same_form(tmp_path: Path) -> None:
    data = episodes.small(4)
    stub, real = learn(tmp_path, data, backend="stub"), learn(tmp_path, data)
    assert stub.contract == real.contract
    assert stub.curve_name == real.curve_name
    with pytest.raises(RuleError, match="the weights do not fit the network"):
        load(stub, BUNDLE)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"every": 8}, "every 8 is more than the 7 predicted steps from the present one"),
        ({"horizon": 9}, "horizon 9 is not a multiple of 2, the shortening by 2 levels"),
        ({"network": "transformer", "heads": 3}, "width 8 is not a multiple of 3 heads"),
        ({"denoisings": 101}, "denoisings 101 is more than noise_levels 100"),
    ],
)
def test_sizes_that_no_network_has_are_one_clear_error(tmp_path: Path, options: dict[str, Any], message: str) -> None:
    with pytest.raises(RuleError, match=message):
        learn(tmp_path, episodes.small(4), **options)


@pytest.mark.parametrize("rule", ["learn.act", "learn.diffusion"])
def test_profile_gpu_trains_with_the_same_code(tmp_path: Path, rule: str) -> None:
    found = RuleRunner(tmp_path).find(rule)
    assert profiles.read("gpu", None).preferred(found)[0] == ("cuda", "torch")
    assert profiles.read("cpu", None).preferred(found)[0] == ("torch",)
    gpu, cpu = found.backends["cuda"], found.backends["torch"]
    assert gpu.facts.gpu_gb > 0
    assert not gpu.facts.cpu
    assert gpu.module.train is cpu.module.train


@pytest.mark.slow
@pytest.mark.parametrize("rule", ["learn.act", "learn.diffusion"])
def test_all_tensors_are_on_the_device_of_the_call(tmp_path: Path, rule: str) -> None:
    """Tensors that have a device and no data take the place of a GPU."""
    found = RuleRunner(tmp_path).find(rule)
    module = found.backends["torch"].module
    episode_set, inputs = episodes.small(2), ("joints", "rgb")
    options = found.rule.options.model_validate({"inputs": inputs, "batch": 4})
    plain = {name: value for name, value in options.model_dump().items() if isinstance(value, int | float | str)}
    parts = parts_of(episode_set, filmed(episode_set))
    data = prepare(BUNDLE, parts, Selection(inputs), algorithm=found.path, settings=plain | {"located": 9})
    learner = module.Learner(data, options)
    real = Samples(data, learner.window).at(np.arange(4))
    network = module.network.of_contract(data.contract)
    with FakeTensorMode() as fake:

        def there(tensors: Mapping[str, Tensor | None]) -> dict[str, Tensor]:
            return {name: fake.from_tensor(each).to("meta") for name, each in tensors.items() if each is not None}

        for part in network.modules():
            part._parameters.update(there(part._parameters))
            part._buffers.update(there(part._buffers))
        rest = there({"actions": real.actions, "keep": real.keep, "places": real.places})
        batch = Batch(there(real.inputs), **rest)
        loss, _ = learner.loss(network, batch, torch.Generator().manual_seed(0))
        assert loss.device.type == learner.predicted(network, batch).device.type == "meta"

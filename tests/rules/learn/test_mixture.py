"""learn.act on mixtures of `demonstrate.mixture`, and on films decoded by `demonstrate.unpack`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.tasks.episode import Episodes, Film
from dextera_build.artifacts.tasks.mixture import Mixture
from dextera_build.errors import RuleError
from dextera_build.learning.samples import Samples
from dextera_build.policy.observation import Measurement, deployable
from dextera_build.testing import RuleRunner
from tests import episodes
from tests.policy.policies import load
from tests.rules.learn.test_act import ACT, learn
from tests.rules.learn.trainings import BUNDLE, filmed


def mixed(tmp_path: Path, weights: Mapping[str, int], **sets: Episodes) -> Mixture:
    made = RuleRunner(tmp_path).run(
        "demonstrate.mixture", sets=Collection[Episodes](items=sets), options={"weights": dict(weights)}
    )
    assert isinstance(made, Mixture)
    return made


def elsewhere(data: Episodes, offset_rad: float = 0.0) -> Episodes:
    """The same episodes as if they were recorded in the reference world, with other actions."""
    items = {
        name: one.model_copy(update={"action": one.action + np.float32(offset_rad)}) for name, one in data.items.items()
    }
    return data.model_copy(update={"items": items, "world": "reference"})


@pytest.mark.medium
def test_every_batch_of_a_mixture_has_exactly_its_share(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data = mixed(tmp_path, {"twin": 3}, twin=episodes.small(8), reference=elsewhere(episodes.small(2, seed=1)))
    sampled, plain = list[np.ndarray](), Samples.at
    monkeypatch.setattr(Samples, "at", lambda own, rows: sampled.append(rows) or plain(own, rows))
    learn(tmp_path, data, batch=16, held_out=0.0)
    first = 2 * 20  # `reference` comes before `twin`
    assert len(sampled) == ACT.small["steps"]
    assert {(int((rows < first).sum()), int((rows >= first).sum())) for rows in sampled} == {(4, 12)}
    assert len(np.unique(np.concatenate(sampled))) == 10 * 20, "both sets are seen as a whole"


@pytest.mark.slow
def test_a_mixture_is_normalised_by_its_weights_and_not_by_its_sizes(tmp_path: Path) -> None:
    near, far = episodes.small(8), elsewhere(episodes.small(2, seed=1), 0.5)
    made = {
        weight: learn(tmp_path, mixed(tmp_path, {"reference": weight}, twin=near, reference=far), held_out=0.0)
        for weight in (1, 3)
    }
    means = [np.concatenate([one.action for one in each.items.values()]).mean(axis=0) for each in (near, far)]
    for weight, checkpoint in made.items():
        expected = (means[0] + weight * means[1]) / (1 + weight)
        np.testing.assert_allclose(checkpoint.contract.action.mean, expected, atol=1e-5)
    assert made[1].contract.dataset != made[3].contract.dataset
    data = mixed(tmp_path, {}, twin=near, reference=far)
    np.testing.assert_allclose(data.action_mean["reference"], means[1], atol=1e-5)


@pytest.mark.slow
def test_a_policy_may_know_its_world(tmp_path: Path) -> None:
    """What is seen is the same in both worlds, and what to do is not."""
    near = episodes.small(4)
    data = mixed(tmp_path, {}, twin=near, reference=elsewhere(near, 0.4))
    options: dict[str, Any] = {"steps": 400, "batch": 32, "held_out": 0.0, "width": 32}
    told = learn(tmp_path, data, inputs=("joints", "objects", "world"), **options)
    assert told.contract.inputs[-1].names == ("twin", "reference")
    shown = near.items["0"]
    seen = deployable(
        Measurement(shown.joints[5], shown.objects[5], shown.displacement[5]), shown.joints[5], shown.goal
    )
    there = BUNDLE.model_copy(update={"kind": "reference"})
    apart = load(told, there).act(seen) - load(told, BUNDLE).act(seen)
    assert np.median(apart) == pytest.approx(0.4, abs=0.1)
    with pytest.raises(RuleError, match="another world"):
        load(told, BUNDLE.model_copy(update={"kind": "perturbed"}))


@pytest.mark.medium
def test_unpacked_pictures_train_the_same_policy(tmp_path: Path) -> None:
    data = episodes.small(4)
    film = filmed(data)
    pixels = RuleRunner(tmp_path).run("demonstrate.unpack", film=film)
    options: dict[str, Any] = {"inputs": ("joints", "rgb"), "steps": 5}
    packed = learn(tmp_path, data, film=film, **options)
    assert learn(tmp_path, data, film=pixels, **options).weights == packed.weights
    mixture = mixed(tmp_path, {}, twin=data, reference=elsewhere(data))
    both = learn(tmp_path, mixture, films=Collection[Film](items={"twin": film, "reference": film}), **options)
    assert both.contract.inputs[1].shape == packed.contract.inputs[1].shape


def test_films_of_other_sizes_are_refused(tmp_path: Path) -> None:
    data = episodes.small(2)
    films = Collection[Film](items={"twin": filmed(data), "reference": filmed(data, 24, 32)})
    mixture = mixed(tmp_path, {}, twin=data, reference=elsewhere(data))
    with pytest.raises(RuleError, match="the films of the parts differ in size") as caught:
        learn(tmp_path, mixture, backend="stub", films=films, inputs=("joints", "rgb"))
    assert caught.value.facts["sizes"] == "`reference` 32 x 24 px, `twin` 48 x 32 px"


@pytest.mark.parametrize(
    ("weights", "change", "message"),
    [
        ({"lab": 1}, {}, "there is no set `lab` to weigh"),
        ({}, {"rate_hz": 10.0}, "the sets `twin` and `reference` differ in `rate_hz`"),
        ({}, {"items": {}}, "the set `reference` has no episode"),
    ],
)
def test_sets_that_do_not_mix_are_refused(
    tmp_path: Path, weights: dict[str, int], change: dict[str, Any], message: str
) -> None:
    data = episodes.small(4)
    with pytest.raises(RuleError, match=message):
        mixed(tmp_path, weights, twin=data, reference=elsewhere(data).model_copy(update=change))


def test_pictures_of_a_mixture_come_by_label(tmp_path: Path) -> None:
    data = episodes.small(2)
    film, mixture = filmed(data), mixed(tmp_path, {}, twin=data, reference=elsewhere(data))
    with pytest.raises(RuleError, match="`film` is for one set of episodes, but a mixture is given"):
        learn(tmp_path, mixture, film=film)
    with pytest.raises(RuleError, match="the films do not match the mixture in `reference`"):
        learn(tmp_path, mixture, films=Collection[Film](items={"twin": film}))

"""Backgrounds that are replaced in training: masks and pictures of the twin, their draws, and what they are for."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.artifacts.tasks.backdrop import Backdrop
from dextera_build.artifacts.tasks.episode import Episodes, Film
from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.errors import RuleError
from dextera_build.learning.augmentation import swapped
from dextera_build.policy.layout import gathered
from dextera_build.policy.observation import Frame
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.rollout import closed_loop
from dextera_build.testing import RuleRunner
from tests import episodes, gate
from tests.policy.policies import load
from tests.rules.learn import test_depth
from tests.rules.learn.test_cameras import ACT, films, picture
from tests.rules.learn.test_mixture import elsewhere, mixed
from tests.rules.learn.trainings import BUNDLE, FEW, MIDDLE, changed, filmed, square

COMMON = test_depth.COMMON | {"inputs": ("joints", "rgb")}


def textures(count: int, seed: int, height: int = 32, width: int = 48) -> np.ndarray:
    """Pictures (N, H, W, 3) of coarse patches of random colours."""
    small = np.random.default_rng(seed).integers(0, 256, (count, height // 8, width // 8, 3), np.uint8)
    return small.repeat(8, axis=1).repeat(8, axis=2)


def behind(data: Episodes, height: int = 32, width: int = 48) -> Backdrop:
    """The backdrop of `filmed`: the box is the foreground."""
    masks = {}
    for name, one in data.items.items():
        shown = np.zeros((len(one.action), height, width), bool)
        for mask, place in zip(shown, one.objects[:, 0, :2], strict=True):
            mask[square(height, width, place)] = True
        masks[name] = Backdrop.packed(shown)
    return Backdrop(masks=masks, pictures=textures(24, 0, height, width))


def pushed() -> Episodes:
    """One episode of the gate."""
    bundle = gate.bundle()
    environment = Environment(bundle)

    class Pushing:
        def reset(self) -> None:
            """Nothing is remembered."""

        def act(self, observation: Any) -> np.ndarray:
            return np.array([gate.target(gate.PUSHES)])

    return gathered(bundle, {"0": closed_loop(environment, Pushing(), environment.draw(3))}, {}, 1)


def cloud() -> Splats:
    """Red Gaussians on the ground before the camera of the gate."""
    places = np.random.default_rng(0).uniform(-0.6, 0.6, (400, 2))
    red = np.array([1.7, -1.7, -1.7], np.float32)  # of degree 0: colour = 0.5 + 0.282 * coefficient
    return Splats(
        means=np.column_stack([places, np.zeros(400)]).astype(np.float32),
        rotations=np.tile(np.array([1, 0, 0, 0], np.float32), (400, 1)),
        scales=np.full((400, 3), 0.08, np.float32),
        opacities=np.full(400, 0.95, np.float32),
        harmonics=np.tile(red, (400, 1, 1)),
        frame="world",
    )


@pytest.mark.medium
def test_foreground_and_background_of_the_twin_make_up_the_film(tmp_path: Path) -> None:
    given = {"bundle": gate.bundle(), "episodes": pushed(), "view": gate.view()}
    film: Film = RuleRunner(tmp_path).run("demonstrate.film", **given)
    still = {"pictures": 2, "shift_m": 0.0, "turn_deg": 0.0, "light": 0.0}
    made: Backdrop = RuleRunner(tmp_path).run("demonstrate.backdrop", options=still, **given)
    masks = Backdrop.unpacked(made.masks["0"], 64)
    assert masks.shape == (len(film.pixels("0")), 48, 64)
    assert 0.02 < masks.mean() < 0.5
    assert (masks[0] != masks[-1]).any(), "the arm moves"
    joined = np.where(masks[..., None], film.pixels("0"), made.pictures[0])
    np.testing.assert_array_equal(joined, film.pixels("0"))
    assert (
        np.abs(film.pixels("0")[masks].astype(int) - np.broadcast_to(made.pictures[0], joined.shape)[masks]).mean() > 20
    )
    moved: Backdrop = RuleRunner(tmp_path).run("demonstrate.backdrop", options={"pictures": 3}, **given)
    assert len({each.tobytes() for each in moved.pictures}) == 3


@pytest.mark.medium
def test_gaussians_give_every_second_background(tmp_path: Path) -> None:
    given = {"bundle": gate.bundle(), "episodes": pushed(), "view": gate.view(), "splats": cloud()}
    made = RuleRunner(tmp_path).run("demonstrate.backdrop", options={"pictures": 4, "shift_m": 0.01}, **given)
    red = (made.pictures[..., 0].astype(int) - made.pictures[..., 2]).mean(axis=(1, 2))
    assert (red[:2] < 60).all()
    assert (red[2:] > 100).all(), "the Gaussians are red"


def test_a_sample_has_one_background_and_keeps_its_foreground() -> None:
    pictures = torch.rand(6, 3, 8, 8)
    kept = torch.zeros(6, 8, 8, dtype=torch.bool)
    kept[:, :2] = True
    others = torch.from_numpy(textures(5, 0, 8, 8))
    random = lambda: torch.Generator().manual_seed(0)  # noqa: E731
    assert torch.equal(swapped(pictures, kept, others, 0.0, 3, random()), pictures)
    made = swapped(pictures, kept, others, 1.0, 3, random())
    assert torch.equal(made[:, :, :2], pictures[:, :, :2])
    assert torch.equal(made[0::2, :, 2:], made[1::2, :, 2:]), "both steps of a sample"
    known = {tuple(each[0, 0].tolist()) for each in others.numpy()}
    assert {tuple(((each[:, 5, 5] + 1.0) * 127.5).round().int().tolist()) for each in made} <= known
    half = swapped(torch.rand(200, 3, 8, 8), kept.new_zeros(200, 8, 8), others, 0.5, 200, random())
    constant = (half.amax(dim=(2, 3)) == half.amin(dim=(2, 3))).all(dim=1)
    assert 70 < int(constant.sum()) < 130


def trained(tmp_path: Path, data: Episodes, swap: float, **more: Any) -> Checkpoint:
    given = {"backdrop": behind(data)} if swap else {}
    return ACT.learn(tmp_path, data, film=filmed(data), swap=swap, **given, **(COMMON | more))


@pytest.mark.slow
def test_a_policy_before_another_background_does_what_the_box_says(tmp_path: Path) -> None:
    """Joint 1 goes to 0.5 or -0.5 rad by the side of the box; the film has a black background alone."""
    sides = np.tile([1.0, -1.0], 6)[:, None] * np.ones(8)
    data = changed(12, 8, 0.5 * sides, MIDDLE[0] + 0.05 * sides)
    more = {"steps": 300, "rate": 3e-3, "held_out": 0.0}
    grounds = np.minimum(2 * textures(20, 1).astype(int), 255).astype(np.uint8)  # no training saw them; some are white
    done = {}
    for swap in (0.0, 0.8):
        policy, one = load(trained(tmp_path, data, swap, **more), BUNDLE, episodes.view(48, 32)), episodes.episode()
        found = []
        for ground in grounds:
            said = []
            for side in (0.05, -0.05):
                seen = np.where(picture(32, 48, side) > 0, np.uint8(255), ground)
                policy.reset()
                said.append(policy.act(test_depth.observed(one, Frame(seen)))[0])
            found.append(said[0] > 0.25 and said[1] < -0.25)
        done[swap] = sum(found)
    assert done[0.8] >= 18, done
    assert done[0.0] <= 10, done


def test_several_cameras_and_mixtures_have_backdrops_by_the_keys_of_their_films(tmp_path: Path) -> None:
    data = episodes.small(3)
    side = behind(data, 40, 40)
    one = Collection[Backdrop](items={"side": side})
    made = ACT.learn(tmp_path, data, films=films(data), backdrops=one, swap=0.5, **(COMMON | FEW))
    plain = ACT.learn(tmp_path, data, films=films(data), **(COMMON | FEW))
    assert made.weights != plain.weights
    assert made.contract.dataset != plain.contract.dataset
    mixture = mixed(tmp_path, {}, twin=data, reference=elsewhere(data))
    shown = Collection[Film](items={"twin": filmed(data), "reference": filmed(data)})
    twin = Collection[Backdrop](items={"twin": behind(data)})
    mixed_made = ACT.learn(tmp_path, mixture, films=shown, backdrops=twin, swap=0.5, **(COMMON | FEW))
    assert np.isfinite(mixed_made.curve).all()


def test_backdrops_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    data = episodes.small(3)
    for given, message in (
        ({"swap": 0.5}, "`swap` needs a `backdrop` to draw from"),
        ({"backdrop": behind(data)}, "a `backdrop` is given, but `swap` is 0"),
        ({"backdrop": behind(data, 40, 40), "swap": 0.5}, "the backdrop of `workspace` is not that of its film"),
        ({"backdrop": behind(episodes.small(2)), "swap": 0.5}, "the backdrop of `workspace` is not that of its film"),
        (
            {"backdrops": Collection[Backdrop](items={"top": behind(data)}), "swap": 0.5},
            "there is no film of `top`, to which a backdrop is given",
        ),
    ):
        with pytest.raises(RuleError) as caught:
            ACT.learn(tmp_path, data, backend="stub", film=filmed(data), **given, **COMMON)
        assert caught.value.message == message
